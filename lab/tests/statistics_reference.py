"""Writes statistics/reference.rs: data of studies with what statsmodels and scipy find in them.

    python3 statistics_reference.py > statistics/reference.rs
"""
import warnings

import numpy as np
import statsmodels.api as sm
from scipy.optimize import brentq, minimize, root
from scipy.stats import norm
from statsmodels.stats.anova import anova_lm
from statsmodels.stats.proportion import proportion_confint
from statsmodels.tools.numdiff import approx_fprime
from statsmodels.formula.api import ols
import pandas as pd

warnings.simplefilter("error", RuntimeWarning)
LOGIT_90, Z_90, Z_95 = np.log(9.0), norm.ppf(0.9), norm.ppf(0.95)


def number(value):
    return "None" if value is None else f"Some({float(value)!r})"


def numbers(values):
    return "&[" + ", ".join(repr(float(value)) for value in values) + "]"


def record(name, fields):
    print(f"    {name} {{")
    for key, value in fields.items():
        print(f"        {key}: {value},")
    print("    },")


def hit_miss(name, size, hit):
    x = np.log(size)
    model = sm.GLM(hit.astype(float), sm.add_constant(x), family=sm.families.Binomial())
    fit = model.fit(maxiter=200, tol=1e-15)
    (b0, b1), v = fit.params, fit.cov_params()
    ln_a90 = (LOGIT_90 - b0) / b1
    gradient = np.array([-1 / b1, -ln_a90 / b1])
    sd = np.sqrt(gradient @ v @ gradient)

    def deviance(at):
        """What curves through 90 % at `at` lose."""
        through = sm.GLM(hit.astype(float), (x - at)[:, None], family=sm.families.Binomial(),
                         offset=np.full(len(x), LOGIT_90))
        return 2 * (fit.llf - through.fit(maxiter=200, tol=1e-15).llf) - Z_95**2

    bound = None
    if 2 * (fit.llf - fit.llnull) > Z_95**2:
        high = ln_a90 + sd
        while deviance(high) < 0:
            high = ln_a90 + 2 * (high - ln_a90)
        bound = np.exp(brentq(deviance, ln_a90, high, xtol=1e-13, rtol=1e-14))
    eta = b0 + b1 * x[0]
    lower = eta - Z_95 * np.sqrt(np.array([1, x[0]]) @ v @ np.array([1, x[0]]))
    record("HitMissCase", dict(
        name=f'"{name}"', sizes=numbers(size), is_hit="&[" + ", ".join(str(bool(h)).lower() for h in hit) + "]",
        coefficients=numbers([b0, b1]).strip("&"), covariance=numbers(v.ravel()).strip("&"),
        log_likelihood=repr(float(fit.llf)), a50=repr(float(np.exp(-b0 / b1))), a90=repr(float(np.exp(ln_a90))),
        a90_95_wald=repr(float(np.exp(ln_a90 + Z_95 * sd))), a90_95_likelihood=number(bound),
        first_pod=repr(float(1 / (1 + np.exp(-eta)))),
        first_pod_lower=repr(float(1 / (1 + np.exp(-lower))))))


def score(beta, x, y, noise, saturation):
    """Log likelihood and its gradient in intercept, slope and ln(scatter)."""
    b0, b1, ln_tau = beta
    tau = np.exp(ln_tau)
    left, right = y <= noise, y >= saturation
    seen = ~left & ~right
    value, gradient = 0.0, np.zeros(3)
    r = (y[seen] - b0 - b1 * x[seen]) / tau
    value += np.sum(-0.5 * r**2 - 0.5 * np.log(2 * np.pi) - ln_tau)
    gradient += [np.sum(r) / tau, np.sum(r * x[seen]) / tau, np.sum(r**2 - 1)]
    for which, limit, sign in ((left, noise, 1), (right, saturation, -1)):
        if which.any():
            u = sign * (limit - b0 - b1 * x[which]) / tau
            hazard = np.exp(norm.logpdf(u) - norm.logcdf(u))
            value += np.sum(norm.logcdf(u))
            gradient += [np.sum(-sign * hazard) / tau, np.sum(-sign * hazard * x[which]) / tau, np.sum(-u * hazard)]
    return value, gradient


def a_hat(name, size, response, is_log, threshold, noise, saturation):
    x = np.log(size)
    scale = np.log if is_log else np.asarray
    y = response if not is_log else np.log(np.maximum(response, 1e-300 if noise is None else noise))
    y_noise = -np.inf if noise is None else float(scale(noise))
    y_saturation = np.inf if saturation is None else float(scale(saturation))
    y = np.clip(y, y_noise, y_saturation)
    y_th = float(scale(threshold))
    line = sm.OLS(y, sm.add_constant(x)).fit()
    tau = np.sqrt(line.ssr / len(x))
    if noise is None and saturation is None:
        (b0, b1), value = line.params, line.llf
        v = np.zeros((3, 3))
        v[:2, :2] = line.cov_params() * line.df_resid / len(x)  # the scatter of maximum likelihood
        v[2, 2] = tau**2 / (2 * len(x))
    else:
        start = minimize(lambda b: -score(b, x, y, y_noise, y_saturation)[0], [*line.params, np.log(tau)],
                         jac=lambda b: -score(b, x, y, y_noise, y_saturation)[1], method="BFGS")
        best = root(lambda b: score(b, x, y, y_noise, y_saturation)[1], start.x, tol=1e-14)
        b0, b1, ln_tau = best.x
        tau, value = np.exp(ln_tau), score(best.x, x, y, y_noise, y_saturation)[0]
        information = -approx_fprime(best.x, lambda b: score(b, x, y, y_noise, y_saturation)[1], centered=True)
        on_tau = np.diag([1, 1, tau])
        v = on_tau @ np.linalg.inv(0.5 * (information + information.T)) @ on_tau
    mu, sigma = (y_th - b0) / b1, tau / b1
    ln_a90 = mu + Z_90 * sigma
    gradient = np.array([-1 / b1, -ln_a90 / b1, Z_90 / b1])

    def deviance(at):
        """What lines with a90 at `at` lose."""
        def through(b):
            return np.array([y_th - b[0] * at + Z_90 * np.exp(b[1]), b[0], b[1]])

        def slopes(b):
            g = score(through(b), x, y, y_noise, y_saturation)[1]
            return np.array([g[1] - at * g[0], g[2] + Z_90 * np.exp(b[1]) * g[0]])
        near = minimize(lambda b: -score(through(b), x, y, y_noise, y_saturation)[0], [b1, np.log(tau)],
                        jac=lambda b: -slopes(b), method="BFGS")
        best = root(slopes, near.x, tol=1e-14)
        return 2 * (value - score(through(best.x), x, y, y_noise, y_saturation)[0]) - Z_95**2

    sd = np.sqrt(gradient @ v @ gradient)
    bound = np.exp(brentq(deviance, ln_a90 + 0.3 * sd, ln_a90 + 6 * sd, xtol=1e-13, rtol=1e-14))
    deviate = (x[0] - mu) / sigma
    along = np.array([1, x[0], -deviate]) / tau
    record("AHatCase", dict(
        name=f'"{name}"', sizes=numbers(size), responses=numbers(response), is_log=str(is_log).lower(),
        threshold=repr(threshold), noise=number(noise), saturation=number(saturation),
        line=numbers([b0, b1, tau]).strip("&"),
        covariance=numbers(v.ravel()).strip("&"), log_likelihood=repr(float(value)),
        mu=repr(float(mu)), sigma=repr(float(sigma)), a90=repr(float(np.exp(ln_a90))),
        a90_95_wald=repr(float(np.exp(ln_a90 + Z_95 * sd))),
        a90_95_likelihood=repr(float(bound)),
        first_pod=repr(float(norm.cdf(deviate))),
        first_pod_lower=repr(float(norm.cdf(deviate - Z_95 * np.sqrt(along @ v @ along))))))


def rates():
    for count, all_, level in ((0, 30, 0.95), (30, 30, 0.95), (1, 1, 0.9), (3, 200, 0.95), (57, 60, 0.99),
                               (17, 41, 0.5), (2500, 5000, 0.95), (12, 100000, 0.95), (300000, 1000000, 0.95)):
        ends = [proportion_confint(count, all_, 1 - level, method=method) for method in ("beta",)]
        values = ", ".join(f"[{float(low)!r}, {float(high)!r}]" for low, high in ends)
        print(f"    ({count}, {all_}, {level!r}, {values}),")


def crossed(rng):
    """A study with an interaction that stays."""
    p, o, r = 6, 3, 2
    y = (10 + rng.normal(0, 2, p)[:, None, None] + rng.normal(0, 0.5, o)[None, :, None]
         + rng.normal(0, 1, (p, o))[:, :, None] + rng.normal(0, 0.4, (p, o, r))).round(2)
    part, operator, _ = np.meshgrid(range(p), range(o), range(r), indexing="ij")
    table = anova_lm(ols("y ~ C(part) * C(operator)", pd.DataFrame(dict(
        y=y.ravel(), part=part.ravel(), operator=operator.ravel()))).fit())
    print(f"pub(crate) const CROSSED: [f64; {y.size}] = {numbers(y.ravel()).strip('&')};")
    print("/// Sums of squares of parts, operators, interaction and repeats; F and p of the interaction.")
    print("#[rustfmt::skip]")
    print("pub(crate) const CROSSED_ANOVA: [f64; 6] =", numbers(
        [*table["sum_sq"], table["F"].iloc[2], table["PR(>F)"].iloc[2]]).strip("&") + ";")


def main():
    rng = np.random.default_rng(20)
    print("//! Studies and what statsmodels and scipy find in them; written by `statistics_reference.py`, not by hand.\n")
    print("use super::a_hat::AHatCase;\nuse super::hit_miss::HitMissCase;\nuse super::rate::RateCase;\n")
    print("#[rustfmt::skip]\npub(crate) const HIT_MISS: &[HitMissCase] = &[")
    for name, n, middle, slope in (("as the handbook wants", 80, 2.0, 4.0), ("few", 14, 2.0, 2.5),
                                   ("steep", 100, 2.0, 20.0), ("hardly rising", 25, 1.5, 0.4)):
        size = np.exp(rng.uniform(np.log(0.5), np.log(8), n)).round(3)
        hit = rng.uniform(size=n) < 1 / (1 + np.exp(-slope * (np.log(size) - np.log(middle))))
        hit_miss(name, size, hit)
    size = np.repeat([1.0, 2.0, 4.0, 8.0], 5)
    hit_miss("tied sizes", size, np.array([0, 0, 0, 0, 1, 0, 0, 1, 0, 1, 1, 0, 1, 1, 1, 1, 1, 0, 1, 1], bool))
    size = np.exp(rng.uniform(np.log(20e-3), np.log(21e-3), 70))
    hit_miss("metres in a narrow range", size, rng.uniform(size=70) < 1 / (1 + np.exp(-60 * np.log(size / 20.4e-3))))
    print("];\n\n#[rustfmt::skip]\npub(crate) const A_HAT: &[AHatCase] = &[")
    size = np.exp(rng.uniform(np.log(0.5), np.log(8), 50)).round(3)
    response = np.exp(0.3 + 0.9 * np.log(size) + rng.normal(0, 0.35, 50)).round(4)
    a_hat("log, nothing cut off", size, response, True, 2.5, None, None)
    a_hat("log, noise", size, response, True, 2.5, 1.2, None)
    a_hat("log, noise and saturation", size, response, True, 2.5, 1.2, 6.0)
    a_hat("log, few above noise", size, response, True, 5.0, 4.0, None)
    size = np.exp(rng.uniform(np.log(2e-3), np.log(30e-3), 24)).round(6)
    response = (90 + 12 * np.log(size) + rng.normal(0, 6, 24)).round(2)
    a_hat("linear, nothing cut off", size, response, False, 35.0, None, None)
    a_hat("linear, noise and saturation", size, response, False, 35.0, 22.0, 45.0)
    print("];\n\n/// Count, all, level; the intervals of Clopper and Pearson and of Wilson.")
    print("#[rustfmt::skip]\npub(crate) const RATES: &[RateCase] = &[")
    rates()
    print("];\n\n/// Readings of 6 parts by 3 operators, 2 each.\n#[rustfmt::skip]")
    crossed(rng)


if __name__ == "__main__":
    main()
