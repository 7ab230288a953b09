"""Writes covariance_reference.csv: scores of sound places, and the covariance that scikit-learn finds in them.

    python3 covariance_reference.py > covariance_reference.csv

Each line is `case,name,numbers`: `sound` lines hold the scores of one place each, `covariance` lines what is expected.
"""
import numpy as np
from sklearn.covariance import LedoitWolf


def scores(seed, sound, cracked, count, correlation=0.95, outliers=0):
    """Normal scores, the last half of them correlated; the first `outliers` of each class far off."""
    rng = np.random.default_rng(seed)
    covariance = np.eye(count)
    covariance[count // 2:, count // 2:] = correlation
    np.fill_diagonal(covariance, 1.0)
    shift = np.resize([1.5, 0.4, 0.0, 1.2, 0.8, 0.9], count)
    classes = []
    for size, mean in [(sound, 0.0), (cracked, shift)]:
        x = rng.standard_normal((size, count)) @ np.linalg.cholesky(covariance).T * np.resize([1.0, 1.3, 0.6], count)
        x[:outliers] *= 8.0
        classes.append(np.round(np.clip(x + mean, -6, 6), 3))
    return classes


def constant(seed, sound, cracked):
    classes = scores(seed, sound, cracked, 6)
    for x in classes:
        x[:, 2] = 0.25
    return classes


CASES = {
    "unequal": scores(1, 60, 35, 6),
    "outliers": scores(2, 40, 40, 6, outliers=4),
    "close": scores(3, 24, 21, 18),
    "constant": constant(4, 30, 25),
    "one": scores(5, 30, 22, 1),
}


def line(case, name, numbers):
    print(",".join([case, name, *(repr(float(x)) for x in np.ravel(numbers))]))


for case, (sound, _) in CASES.items():
    for row in sound:
        line(case, "sound", row)
    line(case, "covariance", LedoitWolf().fit(sound).covariance_)
