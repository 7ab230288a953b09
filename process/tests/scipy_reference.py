"""Writes extractor/reference.rs: cases with the values of numpy and scipy.

    python3 scipy_reference.py > extractor/reference.rs
"""
import math

import numpy as np

from scipy_definitions import NAMES, discriminators

BASE = dict(seed=1, rate=40960.0, count=16384, p=400, is_i16=False, has_force=True, sound_first=False, distance=0.0,
            onset=401.37, tau=1.1e-3, f_max=31.0, sound_unit=1.0, force_unit=1.0, offset=0.0, noise=0.002,
            f_lo=70.0, follow=False)
CASES = {
    "f32 as the rig records it": dict(),
    "i16 as the rig records it": dict(seed=2, is_i16=True, rate=41000.0, distance=0.3, force_unit=222 / 32768,
                                      sound_unit=5 / 32768),
    "i16, odd count, fast": dict(seed=3, is_i16=True, rate=625000.0, count=3127, p=500, onset=501.8, tau=0.3e-3,
                                 force_unit=0.01, sound_unit=1e-3),
    "f32, no force, edge on a bin": dict(seed=4, rate=200000.0, count=2000, p=500, has_force=False, onset=503.2),
    "i16, no force, odd count": dict(seed=5, is_i16=True, count=4095, p=101, has_force=False, onset=150.5,
                                     sound_unit=1e-4),
    "f32 on a large offset, sound first": dict(seed=6, offset=40.0, sound_first=True, count=5008, p=333, onset=350.0),
    "band from 0 Hz": dict(seed=7, f_lo=0.0, offset=0.3, count=8192),
    "f_c follows tau": dict(seed=8, follow=True, count=8192, is_i16=True, force_unit=0.01, sound_unit=1e-4),
    "no baseline": dict(seed=9, p=0, count=4096, offset=1.5),
    "three in four of an odd p": dict(seed=10, p=7, onset=9.3, count=4001, noise=0.01),
    "late microphone": dict(seed=11, distance=40.0, count=4096),
}


def noise(seed, count):
    """A linear congruential generator, uniform in [-0.5, 0.5)."""
    state, out = seed, np.empty(count)
    for i in range(count):
        state = (state * 1664525 + 1013904223) % 2**32
        out[i] = state / 2**32 - 0.5
    return out


def half_sine(t, tau):
    return math.sin(math.pi * t / tau) if 0 < t < tau else 0.0


def channels(c):
    """Force in N and sound in V as the closed form gives them, before the converter."""
    n, fs = c["count"], c["rate"]
    hiss = noise(c["seed"], 2 * n)
    force, sound = np.empty(n), np.empty(n)
    for i in range(n):
        t = (i - c["onset"]) / fs
        s = half_sine(t, c["tau"])
        force[i] = c["f_max"] * (s * math.sqrt(s) + c["noise"] * hiss[i]) + c["offset"]
        t -= c["distance"] / 343.0
        x = 0.6 * half_sine(t, c["tau"])
        if t > 0:
            for f, d, a in [(310.0, 60.0, 0.2), (880.0, 150.0, 0.5), (1730.0, 260.0, 0.3), (4200.0, 500.0, 0.25)]:
                x += a * math.exp(-d * t) * math.sin(2 * math.pi * f * t)
        sound[i] = x + c["noise"] * hiss[n + i] + c["offset"]
    return force, sound


def converted(x, unit, is_i16):
    counts = np.clip(np.floor(x / unit + 0.5), -32768, 32767) if is_i16 else (x / unit).astype(np.float32)
    return counts.astype(np.float64) * unit


def rust(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value)


def main():
    print("//! Cases with the values of numpy and scipy; written by `scipy_reference.py`.")
    print("//! The values of a case are in the order of `Discriminator::ALL`.\n")
    print("use tapline_wire::Discriminator;\n")
    print("use crate::signal::Case;\n")
    print("#[rustfmt::skip]\npub(crate) const CASES: &[(Case, [Option<f64>; Discriminator::COUNT])] = &[")
    for name, changes in CASES.items():
        c = BASE | changes
        force, sound = channels(c)
        force = converted(force, c["force_unit"], c["is_i16"]) if c["has_force"] else None
        sound = converted(sound, c["sound_unit"], c["is_i16"])
        found = discriminators(force, sound, c["rate"], c["p"], c["distance"], f_lo=c["f_lo"], follow=c["follow"])
        fields = ", ".join(f"{key}: {rust(value)}" for key, value in c.items())
        print(f'    (Case {{ name: "{name}", {fields} }}, [')
        values = (f"Some({float(found[key])!r})" if key in found else "None" for key in NAMES)
        print(f"        {', '.join(values)}]),")
    print("];")


if __name__ == "__main__":
    main()
