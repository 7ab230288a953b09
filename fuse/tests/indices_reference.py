"""Writes indices_reference.csv: scores of sound and cracked places, and what scikit-learn learns from them.

    python3 indices_reference.py > indices_reference.csv

Each line is `case,name,numbers`: `sound` and `cracked` lines hold one example's scores each, all others what is
expected.
"""
import numpy as np
from sklearn.covariance import LedoitWolf
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score


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


for case, (sound, cracked) in CASES.items():
    for row in sound:
        line(case, "sound", row)
    for row in cracked:
        line(case, "cracked", row)
    x, y = np.vstack([sound, cracked]), np.repeat([0, 1], [len(sound), len(cracked)])
    ledoit_wolf = LedoitWolf().fit(sound)
    line(case, "covariance", ledoit_wolf.covariance_)
    line(case, "mahalanobis", ledoit_wolf.mahalanobis(sound))
    line(case, "lda", LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto").fit(x, y).coef_)
    logistic = LogisticRegression(C=1.0, solver="newton-cholesky", tol=1e-13, max_iter=1000).fit(x, y)
    line(case, "logistic", [*logistic.coef_[0], logistic.intercept_[0]])
    line(case, "auc", [roc_auc_score(y, column) for column in x.T])
