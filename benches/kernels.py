"""Computes the seven discriminators of taps in memory, once for each line on standard input, and prints a sum when done.

Arguments: a file of 16-bit counts (taps, 2, samples), a file of the units (taps, 2) as 64-bit floats, the number of samples, the
rate in Hz, the samples before the trigger, the distance of the microphone in m, the library of the transform (scipy or mkl), and
how many taps a batch has.
"""

import sys

import numpy as np

from discriminators import Batch


def main(counts_file, units_file, count, rate_hz, pre, distance_m, library, batch):
    if library == "mkl":
        from mkl_fft import rfft
    else:
        from scipy.fft import rfft
    counts = np.fromfile(counts_file, np.int16).reshape(-1, 2, count)
    units = np.fromfile(units_file, np.float64).reshape(-1, 2).astype(np.float32)
    of = Batch(batch, count, rate_hz, pre, rfft)
    for _ in sys.stdin:
        total = 0.0
        for first in range(0, len(counts), batch):
            values = of.seven(counts[first : first + batch], units[first : first + batch], distance_m)
            total += sum(float(v.sum()) for v in values)
        print(total, flush=True)


_, a, b, *rest = sys.argv
main(a, b, int(rest[0]), float(rest[1]), int(rest[2]), float(rest[3]), rest[4], int(rest[5]))
