"""The method's seven discriminators of a batch of taps, as a competent Python program computes them: arrays that are allocated
once, a batched transform of 32-bit numbers, and the values of tapline's defaults.

It leaves out the quality flags, and takes for granted what they check: one pulse, and the beginning of the ringing, lie near the
trigger, within `BEFORE` and `AFTER`."""

import math

import numpy as np

LEVEL = 0.1
HALF_SINE = 1 / (1 - 2 * math.asin(LEVEL) / math.pi)
SOUND_M_PER_S = 343.0
BEFORE, AFTER = 128, 256


def begun(rows, row, at):
    """The integral of the `rows` from their first samples to `at`, by trapezoids of which the last ends between samples."""
    k = at.astype(np.intp)
    part, x, after = at - k, rows[row, k], rows[row, k + 1]
    before = (rows * (np.arange(rows.shape[1], dtype=np.int32) < k[:, None].astype(np.int32))).sum(axis=1)
    return before - 0.5 * rows[:, 0] + 0.5 * x + part * (x + 0.5 * part * (after - x))


class Batch:
    """Buffers for `batch` taps of `count` samples; `rfft` transforms along axis 1."""

    def __init__(self, batch, count, rate_hz, pre, rfft):
        self.rate_hz, self.pre, self.count, self.rfft = rate_hz, pre, count, rfft
        self.first, self.row = pre - BEFORE, np.arange(batch)
        self.force = np.empty((batch, BEFORE + AFTER), np.float32)
        self.sound = np.empty((batch, count), np.float32)
        self.magnitude = np.empty((batch, count - self.first), np.float32)
        self.step_hz = rate_hz / count
        # Both edges of a band are inside.
        self.low, self.cut = (math.ceil(f / self.step_hz) for f in (70.0, 550.0))
        self.high, self.top = (math.floor(f / self.step_hz) + 1 for f in (2000.0, 3000.0))

    def pulse(self, force, row):
        """F_max, tau and onset of the pulses in `force`; both times in samples."""
        top = force.argmax(axis=1)
        a, b, c = (force[row, top + k].astype(np.float64) for k in (-1, 0, 1))
        f_max = b - (a - c) ** 2 / (8 * (a - 2 * b + c))
        level = LEVEL * f_max
        above = force > level[:, None].astype(np.float32)
        rise = above.argmax(axis=1)
        fall = rise + above.sum(axis=1)
        begin, end = (force[row, k - 1] for k in (rise, fall))
        begin = rise - 1 + (level - begin) / (force[row, rise] - begin)
        end = fall - 1 + (level - end) / (force[row, fall] - end)
        tau = (end - begin) * HALF_SINE
        return f_max, tau, begin - (tau - (end - begin)) / 2

    def areas(self, sound, row, onset, tau):
        """A_1 and A_2 of the `sound` from the first sample near the trigger; all in samples."""
        near = sound[:, : BEFORE + AFTER]
        a_1 = np.abs(begun(near, row, onset + tau) - begun(near, row, onset))
        # Between two samples |x| is the line between their magnitudes.
        magnitude = np.abs(sound, out=self.magnitude[: len(sound)])
        whole = magnitude.sum(axis=1) - 0.5 * (magnitude[:, 0] + magnitude[:, -1])
        return a_1, whole - begun(magnitude[:, : BEFORE + AFTER], row, onset + tau)

    def seven(self, counts, units, distance_m):
        """Of the `counts` (taps, 2, samples), whose `units` (taps, 2) are newtons and volts a count; the microphone is `distance_m`
        from each impact."""
        n, pre, rate_hz = len(counts), self.pre, self.rate_hz
        force, sound, row = self.force[:n], self.sound[:n], self.row[:n]
        base = np.median(counts[:, :, : 3 * pre // 4], axis=2).astype(np.float32)
        np.subtract(counts[:, 0, self.first : pre + AFTER], base[:, :1], out=force)
        np.subtract(counts[:, 1], base[:, 1:], out=sound)
        force *= units[:, :1]
        sound *= units[:, 1:2]
        f_max, tau, onset = self.pulse(force, row)
        onset += distance_m / SOUND_M_PER_S * rate_hz
        a_1, a_2 = self.areas(sound[:, self.first :], row, onset, tau)
        bins = self.rfft(sound, axis=1)[:, self.low : self.top]
        power = (bins.real**2 + bins.imag**2) * np.float32(2 / (rate_hz * self.count))
        flexural = power[:, self.cut - self.low : self.high - self.low]
        sum_f = flexural.sum(axis=1)
        pr, p_f, e_f = sum_f / power.sum(axis=1), flexural.max(axis=1), sum_f * self.step_hz
        return f_max, tau / rate_hz, a_1 / rate_hz, a_2 / rate_hz, pr, p_f, e_f
