"""The discriminators as a user of numpy and scipy would write them, for comparison with the extractor."""
import math

import numpy as np
from scipy import signal

NAMES = ["f_max", "tau", "a_1", "a_2", "pr", "p_f", "e_f", "centroid"]


def between(x, at):
    """x at a fractional index, interpolated linearly."""
    return float(np.interp(at, np.arange(len(x)), x))


def trapezoid(x, start, stop, fold=lambda v: v):
    """Integral over indices [start, stop] of fold(x), trapezoids with interpolated ends."""
    inner = np.arange(math.floor(start) + 1, math.ceil(stop))
    t = np.concatenate([[start], inner, [stop]])
    y = np.concatenate([[between(x, start)], x[inner], [between(x, stop)]])
    return float(np.trapezoid(fold(y), t))


def pulse(f):
    """F_max, tau and onset in samples; None if the pulse is not in the record."""
    k = int(np.argmax(f))
    f_max = f[k]
    if 0 < k < len(f) - 1:
        a, b, c = f[k - 1:k + 2]
        f_max = b - (a - c) ** 2 / (8 * (a - 2 * b + c))
    level = 0.1 * f_max
    below = np.flatnonzero(f <= level)
    left, right = below[below < k], below[below > k]
    if f_max <= 0 or len(left) == 0 or len(right) == 0:
        return None
    i, j = left[-1], right[0]
    rise = i + (level - f[i]) / (f[i + 1] - f[i])
    fall = j - 1 + (f[j - 1] - level) / (f[j - 1] - f[j])
    width = fall - rise
    tau = width / (1 - 2 * math.asin(0.1) / math.pi)
    return f_max, tau, rise - (tau - width) / 2


def discriminators(force, sound, fs, p, distance=0.0, f_c=550.0, f_hi=2000.0, f_lo=70.0, f_top=3000.0, follow=False):
    """Values by name, without those that are absent; force and sound are float64 arrays in N and V, or None."""
    found = {}
    m = math.floor(0.75 * p)
    tau = None
    start = None
    if force is not None and m > 0:
        hit = pulse(force - np.median(force[:m]))
        if hit:
            f_max, tau, onset = hit
            found["f_max"], found["tau"] = float(f_max), tau / fs
            start = onset + distance / 343.0 * fs
    if sound is None:
        return found
    if m > 0:
        x = sound - np.median(sound[:m])
        if force is None:
            loud = np.flatnonzero(np.abs(x) > 5 * np.std(x[:p]))
            ringing = float(loud[0]) if len(loud) else None
        elif start is not None and 0 <= start and start + tau < len(x) - 1:
            ringing = start + tau
            found["a_1"] = abs(trapezoid(x, start, ringing)) / fs
        else:
            ringing = None
        if ringing is not None and ringing < len(x) - 1:
            found["a_2"] = trapezoid(x, ringing, len(x) - 1, np.abs) / fs
    else:
        x = sound
    f, psd = signal.periodogram(x, fs, window="boxcar", detrend="constant", scaling="density")
    if follow and tau is not None:
        f_c = 1 / (2 * tau / fs)
    flexural = psd[(f >= f_c) & (f <= f_hi)]
    reference = psd[(f >= f_lo) & (f <= f_top)]
    if len(flexural) and len(reference) and reference.sum() > 0:
        found["pr"] = float(flexural.sum() / reference.sum())
        found["p_f"] = float(flexural.max())
        found["e_f"] = float(flexural.sum() * (f[1] - f[0]))
        found["centroid"] = float((f[(f >= f_lo) & (f <= f_top)] * reference).sum() / reference.sum())
    return found
