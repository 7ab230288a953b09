"""Reference values of the `full` rung, from scipy alone: prints the rows of src/contact/ladder_tests.rs.

Independent of the Rust code: the layer's shear and membrane are written out here, and the membrane coefficient is computed
by quadrature instead of its closed form. Each impact is integrated by two methods, LSODA and DOP853, and a row is printed
only if they agree.

    python3 full_reference.py [scenes [seed [plate]]]
"""

import sys

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from plate_reference import M_1, NU_2, TAN_D, k_c, plate_of

WINDOW_S = 20e-3
KAPPA = 5 / 6


def chi_for(e):
    """Root of chi (1 + e) = ln((1 + chi)/(1 - chi e)); plate_reference.py computes it by integration."""
    excess = lambda chi: (np.log1p(chi) - np.log1p(-chi * e) - chi * (1 + e)) / chi**2
    return brentq(excess, 1e-6, (1 - 1e-12) / e, xtol=1e-14)


def membrane_coefficient(nu):
    """c of a simply supported circular plate, central load, immovable edge (Ritz with the linear shape)."""
    x, w = legendre.leggauss(200)
    s, w = (x + 1) / 2, w / 2
    slope = lambda r: (1 + nu) / (3 + nu) * (-2 * r * (3 + nu) / (1 + nu) + 4 * r * np.log(r) + 2 * r)
    upto = lambda f, r: np.array([(b * w * f(b * s)).sum() for b in np.atleast_1d(r)])
    i_1 = lambda r: upto(lambda q: slope(q) ** 2 / (2 * q), r)
    i_2 = lambda r: upto(lambda q: q * i_1(q), r)
    a = (i_1(1.0)[0] - (1 + nu) * i_2(1.0)[0]) / ((1 - nu) / 2)
    n_r = a / 2 - i_2(s) / s**2
    n_t = a - i_1(s) - n_r
    energy = np.pi * (w * s * (n_r**2 + n_t**2 - 2 * nu * n_r * n_t)).sum()
    return 4 * energy * 3 * (1 - nu) * (3 + nu) / (4 * np.pi)


def layer(h, l, is_full=True):
    """m_p, C, K, K_m of the full rung, or of the plate rung if not `is_full`."""
    m_p, damping, k_f = plate_of(h, l)
    if not is_full:
        return m_p, damping, k_f, 0.0
    k = k_f / (1 + 2 * (1 + NU_2) * (h / l) ** 2 / KAPPA)
    return m_p, TAN_D * np.sqrt(k * m_p), k, membrane_coefficient(NU_2) * k_f / h**2


def impact(v, chi, k, plate, method):
    """F_max, contact time, d_max, restitution: phases of contact and of flight, each ended by an event."""
    m_p, c, k_2, k_m = plate

    def law(y):
        a, da = y[0] - y[2], y[1] - y[3]
        return np.where(a > 0, k * np.abs(a) ** 1.5 * (1 + chi * da / v), 0.0)

    def contact(_, y):
        f = law(y)
        return [y[1], -f / M_1, y[3], (f - c * y[3] - k_2 * y[2] - k_m * y[2] ** 3) / m_p]

    def flight(_, y):
        return [y[1], 0.0, y[3], (-c * y[3] - k_2 * y[2] - k_m * y[2] ** 3) / m_p]

    def gap(_, y):
        return y[0] - y[2]

    def pull(_, y):
        return 1 + chi * (y[1] - y[3]) / v

    gap.terminal = pull.terminal = True
    t, y, touching = 0.0, np.array([0.0, v, 0.0, 0.0]), True
    f_max = d_max = last = velocity = 0.0
    for _ in range(1000):
        gap.direction, pull.direction = (-1, -1) if touching else (1, 1)
        s = solve_ivp(
            contact if touching else flight, [t, WINDOW_S], y, method=method, rtol=1e-10, atol=1e-13,
            max_step=5e-5, events=(gap, pull), dense_output=True,
        )
        ts = np.linspace(s.t[0], s.t[-1], 4001)
        ys = s.sol(ts)
        dt = ts[1] - ts[0]
        if touching:
            f_max = max(f_max, refined(lambda q: float(law(s.sol(q))), ts, law(ys), dt))
        d_max = max(d_max, refined(lambda q: s.sol(q)[0], ts, ys[0], dt))
        t, y = s.t[-1], s.y[:, -1]
        if touching:
            last, velocity = t, y[1]
        if s.status != 1:
            break
        touching = False if touching else (y[0] - y[2] >= -1e-12 and 1 + chi * (y[1] - y[3]) / v >= -1e-9)
    return np.array([f_max, last, d_max, -velocity / v])


def refined(f, ts, values, dt):
    """The largest value of f, searched within a step of its largest sample."""
    i = int(np.argmax(values))
    if i in (0, len(ts) - 1):
        return values[i]
    found = minimize_scalar(lambda q: -f(q), bounds=(ts[i] - dt, ts[i] + dt), method="bounded", options={"xatol": 1e-12})
    return max(values[i], -found.fun)


if __name__ == "__main__":
    count, seed = (int(x) for x in (sys.argv[1:3] + ["16", "1"][len(sys.argv) - 1 :])[:2])
    is_full = "plate" not in sys.argv[3:]
    rng = np.random.default_rng(seed)
    print("// velocity, restitution, h, l; F_max, contact time, d_max, restitution")
    while count > 0:
        v, e = round(rng.uniform(0.3, 2.5), 3), round(rng.uniform(0.15, 0.95), 3)
        h, l = round(np.exp(rng.uniform(np.log(1.5e-3), np.log(40e-3))), 6), round(rng.uniform(8e-3, 50e-3), 6)
        try:
            one, other = (impact(v, chi_for(e), k_c(), layer(h, l, is_full), m) for m in ("DOP853", "LSODA"))
        except ValueError as error:  # scipy cannot bracket an event at the restart itself
            print(f"// ({v}, {e}, {h}, {l}): {error}", flush=True)
            continue
        if np.all(np.abs(one / other - 1) < 1e-6):
            print(f"({v}, {e}, {h}, {l}, [{', '.join(f'{x:.9e}' for x in one)}]),", flush=True)
            count -= 1
        else:
            print(f"// ({v}, {e}, {h}, {l}): {one} {other}", flush=True)
