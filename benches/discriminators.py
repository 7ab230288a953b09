"""The method's seven discriminators of a batch of taps, as a competent Python program computes them: arrays that are allocated
once, a batched transform of 32-bit numbers, no quality flags."""

import numpy as np


class Batch:
    """Buffers for `batch` taps of `count` samples; `rfft` transforms along axis 1."""

    def __init__(self, batch, count, rate_hz, pre, rfft):
        self.rate_hz, self.pre, self.count, self.rfft = rate_hz, pre, count, rfft
        self.force, self.sound = np.empty((batch, count), np.float32), np.empty((batch, count), np.float32)
        step_hz = rate_hz / count
        self.step_hz = step_hz
        self.low, self.cut, self.high = (int(np.ceil(f / step_hz)) for f in (1.0, 550.0, 3000.0))

    def seven(self, counts, units):
        """Of the `counts` (taps, 2, samples), whose `units` (taps, 2) are newtons and volts a count."""
        n, pre, rate_hz = len(counts), self.pre, self.rate_hz
        force, sound = self.force[:n], self.sound[:n]
        np.multiply(counts[:, 0], units[:, :1], out=force)
        np.multiply(counts[:, 1], units[:, 1:2], out=sound)
        quiet = 3 * pre // 4
        force -= np.median(force[:, :quiet], axis=1, keepdims=True)
        sound -= np.median(sound[:, :quiet], axis=1, keepdims=True)
        window = force[:, pre // 2 : pre + 1024]
        f_max = window.max(axis=1)
        above = window > 0.1 * f_max[:, None]
        tau = above.sum(axis=1) / rate_hz
        a_1 = np.abs(sound[:, pre : pre + 128]).sum(axis=1) / rate_hz
        a_2 = np.abs(sound[:, pre + 128 : pre + 1024]).sum(axis=1) / rate_hz
        bins = self.rfft(sound, axis=1)[:, : self.high]
        power = (bins.real**2 + bins.imag**2) * np.float32(2 / (rate_hz * self.count))
        e_f = power[:, self.cut :].sum(axis=1) * self.step_hz
        pr = e_f / (power[:, self.low :].sum(axis=1) * self.step_hz)
        p_f = power[:, self.cut :].max(axis=1)
        return f_max, tau, a_1, a_2, pr, p_f, e_f
