"""Writes extractor/estimators_reference.rs: taps, settings of estimators, and the values of numpy and scipy.

    python3 scipy_estimators.py > extractor/estimators_reference.rs
"""
import math

import numpy as np
from scipy import integrate, signal

from scipy_definitions import NAMES, trapezoid
from scipy_reference import BASE, channels, converted, rust

BANDS = dict(f_c=550.0, f_hi=2000.0, f_lo=70.0, f_top=3000.0)
QUICK = dict(count=4096)
COUNTS = dict(is_i16=True, force_unit=222 / 32768, sound_unit=5 / 32768)
CASES = [
    (QUICK, dict(f_max="raw")),
    (QUICK, dict(f_max="polynomial")),
    (QUICK | COUNTS | dict(seed=12, noise=0.05), dict(f_max="polynomial", tau="width_50")),
    (QUICK | dict(rate=5000.0, count=1024, p=100, onset=101.3), dict(f_max="polynomial")),
    (QUICK, dict(tau="width_02")),
    (QUICK, dict(tau="width_50")),
    (QUICK, dict(tau="impulse")),
    (QUICK | dict(p=5, onset=5.5), dict(tau="impulse")),
    (QUICK, dict(droop_time_constant_s=0.01)),
    (QUICK | COUNTS | dict(seed=16, offset=2.0), dict(droop_time_constant_s=0.1, f_max="polynomial", tau="impulse")),
    (QUICK | dict(rate=41000.0), dict(band_edges="fractional")),
    (QUICK | COUNTS | dict(seed=18, has_force=False), dict(record_s=0.05)),
    (dict(seed=17, rate=41000.0, noise=0.02), dict(record_s=0.1, band_edges="fractional")),
    (QUICK | dict(f_lo=0.0), dict(band_edges="fractional")),
    (dict(noise=0.05), dict(subtract="noise")),
    (COUNTS | dict(seed=22, noise=0.03), dict(subtract="noise", record_s=0.05)),
    (QUICK | dict(seed=23, offset=0.2), dict(subtract="hum")),
    (COUNTS | dict(seed=24, noise=0.02), dict(subtract="both", mains_hz=60.0, record_s=0.05, band_edges="fractional")),
    (QUICK | dict(p=100, onset=101.0), dict(subtract="hum")),
]


def vertex(f, k):
    if not 0 < k < len(f) - 1:
        return f[k]
    a, b, c = f[k - 1:k + 2]
    return b - (a - c) ** 2 / (8 * (a - 2 * b + c)) if a - 2 * b + c < 0 else b


def crossings(f, k, level):
    below = np.flatnonzero(f <= level)
    left, right = below[below < k], below[below > k]
    if len(left) == 0 or len(right) == 0:
        return None
    i, j = left[-1], right[0]
    return i + (level - f[i]) / (f[i + 1] - f[i]), j - 1 + (f[j - 1] - level) / (f[j - 1] - f[j])


def polynomial(f, k):
    inside = f > 0.7 * vertex(f, k)
    low, high = k, k
    while inside[low - 1]:
        low -= 1
    while inside[high + 1]:
        high += 1
    if high - low + 1 < 9:
        return vertex(f, k)
    x = np.linspace(-1, 1, high - low + 1)
    fit = np.polynomial.Polynomial.fit(x, f[low:high + 1], 4, domain=[-1, 1])
    roots = fit.deriv().roots()
    tops = [r.real for r in roots if abs(r.imag) < 1e-12 and abs(r.real) <= 1] + [-1, 1]
    return max(fit(t) for t in tops)


def without_droop(f, constant):
    k = int(np.argmax(f))
    rise, fall = crossings(f, k, 0.1 * vertex(f, k))
    width = fall - rise
    first, last = max(0, math.floor(rise - width)), min(len(f) - 1, math.floor(fall + 2 * width))
    part = np.concatenate([[0.0], f[first:last + 1]])
    x = f.copy()
    x[first:last + 1] += integrate.cumulative_trapezoid(part) / constant
    return x


def pulse(f, fs, settings):
    if settings.get("droop_time_constant_s"):
        f = without_droop(f, settings["droop_time_constant_s"] * fs)
    k = int(np.argmax(f))
    peaks = dict(raw=lambda f, k: f[k], parabola=vertex, polynomial=polynomial)
    f_max = peaks[settings.get("f_max", "parabola")](f, k)
    ten = crossings(f, k, 0.1 * f_max)
    rise, fall = ten
    width = fall - rise

    def base(level):
        found = crossings(f, k, level * f_max)
        return found and (found[1] - found[0]) / (1 - 2 * math.asin(level) / math.pi)

    kind = settings.get("tau", "half_sine")
    if kind == "impulse":
        ends = max(0, rise - width / 2), min(len(f) - 1, fall + width / 2)
        tau = math.pi * trapezoid(f, *ends) / (2 * f_max)
    else:
        tau = base(dict(half_sine=0.1, width_02=0.02, width_50=0.5)[kind]) or base(0.1)
    return f_max, tau, rise - (base(0.1) - width) / 2


def overlap(f, df, low, high, kind):
    if kind == "bins":
        return ((f >= low) & (f <= high)).astype(float)
    return np.clip((np.minimum(f + df / 2, high) - np.maximum(f - df / 2, low)) / df, 0, 1)


def spectrum(x, fs, m, settings, f_lo):
    n = len(x)
    f = np.fft.rfftfreq(n, 1 / fs)
    df = f[1]
    psd = np.abs(np.fft.rfft(x - x.mean())) ** 2 / (fs * n)
    psd[1:len(psd) - (n % 2 == 0)] *= 2
    psd[0] = 0
    kind = settings.get("band_edges", "bins")
    flexural = overlap(f, df, BANDS["f_c"], BANDS["f_hi"], kind)
    reference = overlap(f, df, f_lo, BANDS["f_top"], kind)
    centroid = (f * psd * reference).sum() / (psd * reference).sum()
    e_f, e_all, p_f = (psd * flexural).sum() * df, (psd * reference).sum() * df, psd[flexural >= 0.5].max()
    if settings.get("subtract") in ["noise", "both"]:
        g, noise = signal.periodogram(x[:m], fs, window="hann", detrend="constant", scaling="density")
        noise[0] = 0
        part = [(noise * overlap(g, g[1], low, high, "fractional")).sum() * g[1]
                for low, high in [(BANDS["f_c"], BANDS["f_hi"]), (f_lo, BANDS["f_top"])]]
        e_f, e_all = e_f - part[0], e_all - part[1]
        p_f -= part[0] / (BANDS["f_hi"] - BANDS["f_c"])
    return dict(pr=e_f / e_all, p_f=p_f, e_f=e_f, centroid=centroid)


def magnitude_of_noise(x, ringing, sigma):
    rest = x[math.floor(ringing) + 1:]
    blocks = [rest[k:k + 256] for k in range(0, len(rest), 256)]
    return math.sqrt(2 / math.pi) * sigma * sum(min(1.0, sigma ** 2 / np.mean(b ** 2)) * len(b) for b in blocks)


def discriminators(c, settings):
    force, sound = channels(c)
    force, sound = converted(force, c["force_unit"], c["is_i16"]), converted(sound, c["sound_unit"], c["is_i16"])
    fs, m, found = c["rate"], math.floor(0.75 * c["p"]), {}
    if settings.get("record_s"):
        used = math.ceil(settings["record_s"] * fs)
        force, sound = force[:used], sound[:used]
    base = np.median(sound[:m]) if m else 0.0
    x = sound - base
    if settings.get("subtract") in ["hum", "both"]:
        hum_hz = settings.get("mains_hz", 50.0)
        if m * hum_hz / fs >= 0.25:
            w = 2 * math.pi * hum_hz / fs * np.arange(len(x))
            columns = np.stack([np.ones(len(x)), np.cos(w), np.sin(w)], axis=1)
            x = x - columns @ np.linalg.lstsq(columns[:m], x[:m], rcond=None)[0]
    if m and c["has_force"]:
        f_max, tau, onset = pulse(force - np.median(force[:m]), fs, settings)
        found |= dict(f_max=f_max, tau=tau / fs, a_1=abs(trapezoid(x, onset, onset + tau)) / fs)
        ringing = onset + tau
    elif m:
        ringing = float(np.flatnonzero(np.abs(sound - base) > 5 * np.std(sound[:c["p"]]))[0])
    if m:
        found["a_2"] = trapezoid(x, ringing, len(x) - 1, np.abs) / fs
        if settings.get("subtract") in ["noise", "both"]:
            found["a_2"] = max(0.0, found["a_2"] - magnitude_of_noise(x, ringing, np.std(x[:m])) / fs)
    return found | spectrum(x, fs, m, settings, c["f_lo"])


def main():
    print("//! Cases of the estimators, with the values of numpy and scipy; written by `scipy_estimators.py`.")
    print("//! The values of a case are in the order of `Discriminator::ALL`.\n")
    print("use tapline_wire::Discriminator;\n")
    print("use crate::signal::Case;\n")
    print("#[rustfmt::skip]\npub(crate) const CASES: &[(Case, &str, [Option<f64>; Discriminator::COUNT])] = &[")
    for changes, settings in CASES:
        c = BASE | changes
        toml = "\\n".join(f"{key} = {value!r}" for key, value in settings.items())
        found = discriminators(c, settings)
        fields = ", ".join(f"{key}: {rust(value)}" for key, value in c.items())
        print(f'    (Case {{ name: "{toml}", {fields} }}, "{toml}", [')
        values = (f"Some({float(found[key])!r})" if key in found else "None" for key in NAMES)
        print(f"        {', '.join(values)}]),")
    print("];")


main()
