"""Computes the method's seven discriminators of every tap of an archive, as a competent Python program does. Arguments: the
archive, and how many seconds of each record are used (0 for all of it).

h5py reads the samples in batches; the transform is scipy.fft's. Prints the seconds from opening the file to the last tap, and
sums that show that the work was done.
"""

import sys
import time

import h5py
import numpy as np
from scipy.fft import rfft

from discriminators import Batch

try:
    import hdf5plugin  # noqa: F401
except ImportError:
    pass  # the system's own Blosc plugin works too

BATCH = 16


def main(path, record_s):
    begin = time.perf_counter()
    with h5py.File(path, "r") as archive:
        samples, headers = archive["taps/samples"], archive["taps/header"][:]
        rate_hz, pre = float(samples.attrs["sample_rate_hz"]), int(samples.attrs["pre_trigger_samples"])
        tap_count, count = np.count_nonzero(archive["ledger"]["state"] == 1), samples.shape[2]  # spare rows come last
        if record_s > 0:
            count = min(count, int(np.ceil(record_s * rate_hz)))
        counts, of = np.empty((BATCH, 2, count), np.int16), Batch(BATCH, count, rate_hz, pre, rfft)
        sums = np.zeros(7)
        for first in range(0, tap_count, BATCH):
            n = min(BATCH, tap_count - first)
            samples.read_direct(counts, np.s_[first : first + n, :, :count], np.s_[:n])
            units = headers["unit_per_count"][first : first + n].astype(np.float32)
            distance_m = headers["microphone_distance_m"][first : first + n]
            sums += [values.sum() for values in of.seven(counts[:n], units, distance_m)]
    return time.perf_counter() - begin, *sums


for _ in range(2):  # untimed first: plans, plugins and pages are there then
    line = main(sys.argv[1], float(sys.argv[2]))
print(*line)
