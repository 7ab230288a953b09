"""Computes the method's seven discriminators of every tap of an archive, as a competent Python program does. Arguments: the
archive, and how many seconds of each record are used (0 for all of it).

h5py reads the samples in batches, into arrays that are allocated once; the transform is scipy.fft's, of 32-bit numbers, in
batches. Prints the seconds from opening the file to the last tap, and sums that show that the work was done.
"""

import sys
import time

import h5py
import numpy as np
import scipy.fft

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
        tap_count, _, count = samples.shape
        if record_s > 0:
            count = min(count, int(np.ceil(record_s * rate_hz)))
        counts = np.empty((BATCH, 2, count), np.int16)
        force, sound = np.empty((BATCH, count), np.float32), np.empty((BATCH, count), np.float32)
        step_hz = rate_hz / count
        low, cut, high = (int(np.ceil(f / step_hz)) for f in (1.0, 550.0, 3000.0))
        sums = np.zeros(7)
        for first in range(0, tap_count, BATCH):
            n = min(BATCH, tap_count - first)
            samples.read_direct(counts, np.s_[first : first + n, :, :count], np.s_[:n])
            units = headers["unit_per_count"][first : first + n].astype(np.float32)
            np.multiply(counts[:n, 0], units[:, :1], out=force[:n])
            np.multiply(counts[:n, 1], units[:, 1:2], out=sound[:n])
            quiet = 3 * pre // 4
            force[:n] -= np.median(force[:n, :quiet], axis=1, keepdims=True)
            sound[:n] -= np.median(sound[:n, :quiet], axis=1, keepdims=True)
            window = force[:n, pre // 2 : pre + 1024]
            f_max = window.max(axis=1)
            above = window > 0.1 * f_max[:, None]
            tau = above.sum(axis=1) / rate_hz
            a_1 = np.abs(sound[:n, pre : pre + 128]).sum(axis=1) / rate_hz
            a_2 = np.abs(sound[:n, pre + 128 : pre + 1024]).sum(axis=1) / rate_hz
            bins = scipy.fft.rfft(sound[:n], axis=1)[:, :high]
            power = (bins.real**2 + bins.imag**2) * np.float32(2 / (rate_hz * count))
            e_f = power[:, cut:].sum(axis=1) * step_hz
            pr = e_f / (power[:, low:].sum(axis=1) * step_hz)
            p_f = power[:, cut:].max(axis=1)
            sums += [values.sum() for values in (f_max, tau, a_1, a_2, pr, p_f, e_f)]
    print(time.perf_counter() - begin, *sums)


main(sys.argv[1], float(sys.argv[2]))
