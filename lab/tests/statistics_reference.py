"""Writes statistics/reference.rs: data of studies with what statsmodels and scipy find in them.

    python3 statistics_reference.py > statistics/reference.rs
"""
import warnings

import numpy as np
import statsmodels.api as sm
from scipy.optimize import brentq, root
from scipy.stats import norm
from statsmodels.stats.anova import anova_lm
from statsmodels.stats.proportion import proportion_confint
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
        a90_95_likelihood=number(bound), first_pod=repr(float(1 / (1 + np.exp(-eta)))),
        first_pod_lower=repr(float(1 / (1 + np.exp(-lower))))))


def a_hat(name, size, response, threshold):
    x, n = np.log(size), len(size)
    line = sm.OLS(response, sm.add_constant(x)).fit()
    (b0, b1), tau = line.params, np.sqrt(line.ssr / n)  # the scatter of maximum likelihood
    v = np.zeros((3, 3))
    v[:2, :2] = line.cov_params() * line.df_resid / n
    v[2, 2] = tau**2 / (2 * n)
    mu, sigma = (threshold - b0) / b1, tau / b1
    ln_a90 = mu + Z_90 * sigma
    gradient = np.array([-1 / b1, -ln_a90 / b1, Z_90 / b1])

    def deviance(at):
        """What lines with a90 at `at` lose; they are of a slope and of ln(scatter)."""
        def residuals(b):
            return (response - threshold - b[0] * (x - at)) / np.exp(b[1]) - Z_90

        def score(b):
            r = residuals(b)
            return [np.sum(r * (x - at)) / np.exp(b[1]), np.sum(r * (r + Z_90)) - n]
        best = root(score, [b1, np.log(tau)], tol=1e-14).x
        return 2 * (line.llf - np.sum(norm.logpdf(residuals(best)) - best[1])) - Z_95**2

    sd = np.sqrt(gradient @ v @ gradient)
    bound = np.exp(brentq(deviance, ln_a90 + 0.3 * sd, ln_a90 + 6 * sd, xtol=1e-13, rtol=1e-14))
    deviate = (x[0] - mu) / sigma
    along = np.array([1, x[0], -deviate]) / tau
    record("AHatCase", dict(
        name=f'"{name}"', sizes=numbers(size), responses=numbers(response), threshold=repr(float(threshold)),
        line=numbers([b0, b1, tau]).strip("&"), covariance=numbers(v.ravel()).strip("&"),
        mu=repr(float(mu)), sigma=repr(float(sigma)), a90=repr(float(np.exp(ln_a90))),
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
    a_hat("logarithms of responses", size, np.log(response), np.log(2.5))
    size = np.exp(rng.uniform(np.log(2e-3), np.log(30e-3), 24)).round(6)
    response = (90 + 12 * np.log(size) + rng.normal(0, 6, 24)).round(2)
    a_hat("responses as they are", size, response, 35.0)
    print("];\n\n/// Count, all, level; the interval of Clopper and Pearson.")
    print("#[rustfmt::skip]\npub(crate) const RATES: &[RateCase] = &[")
    rates()
    print("];\n\n/// Readings of 6 parts by 3 operators, 2 each.\n#[rustfmt::skip]")
    crossed(rng)


if __name__ == "__main__":
    main()
