"""Reference values of the `plate` and damped integral rungs, from scipy alone: prints the rows of src/contact/impact_tests.rs.

Independent of the Rust code: SI units, chi by integrating the contact itself, DOP853 with rtol 1e-10. Every switch of
the right-hand side is an event at which the integration stops and restarts.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

RHO_1, E_1, NU_1 = 2700.0, 70e9, 0.30
RHO_2, E_2, NU_2 = 1143.0, 17.9e6, 0.49
M_1, M_2, W = 0.0045, 1.6483, 50.8e-3
TAN_D = -np.log(0.25) / np.pi
WINDOW_S = 20e-3


def restitution_of(chi):
    def rate(_, y):
        return [y[1], -max(y[0], 0.0) ** 1.5 * (1 + chi * y[1])]

    def part(_, y):
        return y[0]

    part.terminal, part.direction = True, -1
    s = solve_ivp(rate, [0, 100], [0, 1], method="DOP853", rtol=1e-11, atol=1e-13, events=part)
    return -s.y_events[0][0][1]


def chi_for(e):
    return brentq(lambda chi: restitution_of(chi) - e, 1e-3, 9.0, xtol=1e-12)


def k_c():
    r_1, r_2 = [(3 * m / (4 * np.pi * rho)) ** (1 / 3) for m, rho in ((M_1, RHO_1), (M_2, RHO_2))]
    return 4 / 3 * np.sqrt(r_1 * r_2 / (r_1 + r_2)) / ((1 - NU_1**2) / E_1 + (1 - NU_2**2) / E_2)


def impact(v, m, chi, k, plate):
    """F_max, contact time, d_max, restitution; `plate` is (m_p, C, K_f) or None."""

    def law(y):
        a, da = y[0] - y[2], y[1] - y[3]
        return k * a**1.5 * (1 + chi * da / v) if a > 0 else 0.0

    def rate_with(touching):
        def rate(_, y):
            f = law(y) if touching else 0.0
            if plate is None:
                return [y[1], -f / m, 0.0, 0.0]
            return [y[1], -f / m, y[3], (f - plate[1] * y[3] - plate[2] * y[2]) / plate[0]]

        return rate

    def gap(_, y):
        return y[0] - y[2]

    def pull(_, y):
        return 1 + chi * (y[1] - y[3]) / v

    gap.terminal = pull.terminal = True
    t, y, touching = 0.0, np.array([0.0, v, 0.0, 0.0]), True
    f_max = d_max = last = velocity = 0.0
    for _ in range(10_000):
        gap.direction, pull.direction = (-1, -1) if touching else (1, 1)
        s = solve_ivp(
            rate_with(touching), [t, WINDOW_S], y, method="DOP853", rtol=1e-10, atol=1e-15,
            max_step=2e-6 if touching else 2e-5, events=(gap, pull), dense_output=True,
        )
        for lo, hi in zip(s.t[:-1], s.t[1:]):
            ys = s.sol(np.linspace(lo, hi, 9))
            f_max = max(f_max, max(law(ys[:, i]) for i in range(9)) if touching else 0.0)
            d_max = max(d_max, ys[0].max())
        t, y = s.t[-1], s.y[:, -1]
        if touching:
            last, velocity = t, y[1]
        if s.status != 1 or plate is None:
            break
        if touching:
            touching = False
        else:
            touching = y[0] - y[2] >= -1e-14 and 1 + chi * (y[1] - y[3]) / v >= -1e-12
    return f_max, last, d_max, -velocity / v


def plate_of(h, l):
    ratio = 0.568 + 0.08 * (W / l - 1) if W / l <= 2 else 0.648 + 0.00045 * (W / l - 2)
    k_f = 4 * np.pi * h**3 / (3 * (ratio * l) ** 2) * E_2 / ((1 - NU_2) * (3 + NU_2))
    m_p = RHO_2 * W * l * h / 4
    return m_p, k_f * TAN_D / np.sqrt(k_f / m_p), k_f


if __name__ == "__main__":
    for e in (0.3, 0.5, 0.7, 0.9):
        print(f"chi({e}) = {chi_for(e):.10f}")
    print("// velocity, restitution, h, l; F_max, contact time, d_max, restitution")
    for v, e in ((1.85, 0.5), (1.2, 0.8)):
        row = impact(v, 1 / (1 / M_1 + 1 / M_2), chi_for(e), k_c(), None)
        print(f"integral ({v}, {e}, [{', '.join(f'{x:.9e}' for x in row)}]),")
    for v, e, h, l in (
        (1.85, 0.5, 25.4e-3, 25.4e-3),
        (1.85, 0.5, 12.7e-3, 25.4e-3),
        (1.85, 0.5, 2.54e-3, 25.4e-3),
        (1.2, 0.5, 6.35e-3, 20e-3),
        (1.85, 0.7, 5e-3, 50.8e-3),
        (0.5, 0.9, 3e-3, 30e-3),
        (2.0, 0.5, 1e-3, 25.4e-3),
        (1.85, 0.5, 12.7e-3, 50.8e-3),
    ):
        row = impact(v, M_1, chi_for(e), k_c(), plate_of(h, l))
        print(f"({v}, {e}, {h}, {l}, [{', '.join(f'{x:.9e}' for x in row)}]),", flush=True)
