"""RAHT and the coding of its coefficients: format.md, section 7."""
import numpy as np

from entropy import Models, Symbols

F = np.float32


class Merges:
    """The merges of a chunk (7.1). Entry 0 of each array stands for no merge."""

    def __init__(self, codes):
        self.count = n = len(codes)
        self.bit = [64] + [(a ^ b).bit_length() - 1 for a, b in zip(codes, codes[1:])] + [64]
        self.first, self.last, self.parent = ([0] * n for _ in range(3))
        higher = [0]
        for j in range(1, n + 1):
            while self.bit[higher[-1]] < self.bit[j]:
                self.last[higher.pop()] = j
            if j < n:
                self.first[j] = higher[-1]
                higher.append(j)
        for j in range(1, n):
            before, behind = self.first[j], self.last[j]
            self.parent[j] = before if self.bit[before] < self.bit[behind] else behind % n
        self.first, self.last, self.parent = map(np.array, (self.first, self.last, self.parent))
        bits = np.array(self.bit[:n])
        self.stages = [np.flatnonzero(bits == bit) for bit in range(62, -1, -1) if bit in bits]


class Raht:
    """Decodes the attributes of a chunk, for one weight per leaf."""

    def __init__(self, block, merges, weights):
        self.block, self.merges = block, merges
        first, last, j = merges.first, merges.last, np.arange(merges.count)
        weights = np.array(weights, np.float64)
        sums, squares = (np.concatenate([[0.0], np.add.accumulate(v)]) for v in (weights, weights * weights))
        self.total = sums[-1]
        with np.errstate(all="ignore"):  # entry 0 is no merge
            w1, w2 = sums[j] - sums[first], sums[last] - sums[j]
            s1, s2 = squares[j] - squares[first], squares[last] - squares[j]
            inverse = (w1 + w2) / (w1 * w2)
            self.share = F(w2 / (w1 + w2))
            self.scale = F(np.sqrt(inverse))
            self.gain = F(np.sqrt((s1 / (w1 * w1) + s2 / (w2 * w2)) / inverse))

    def attribute(self, channels, step):
        """The values, one row per leaf and one column per channel (7.3, 7.6)."""
        merges, step = self.merges, F(step)
        values = np.zeros((merges.count, channels), F)
        values[0] = [F(self.block.signed_gamma() * np.float64(step) / np.sqrt(self.total))
                     for _ in range(channels)]
        activity = np.zeros((merges.count, 3), F)
        rows = Rows(self.block, channels)
        per_activity = F([0.5 / max(len(range(a, channels, 3)), 1) for a in range(3)])
        for stage in merges.stages:
            gain = self.gain[stage, None]
            inherited = activity[merges.parent[stage]]
            coefficients, active = rows.stage(inherited * gain)
            sums = np.stack([sum_cut(abs(coefficients[:, a::3])) for a in range(3)], 1)
            activity[stage] = inherited * F(0.5) + F(sums) * (per_activity * (F(1) / gain))
            d = F(coefficients) * step * self.scale[stage, None]
            left = values[merges.first[stage]]
            moved = left - d * self.share[stage, None]
            active = active[:, None]
            values[merges.first[stage]] = np.where(active, moved, left)
            values[stage] = np.where(active, moved + d, left)  # merge j's right side begins with leaf j
        return values


class Rows:
    """The coefficients of an attribute, stage by stage (7.4, 7.5)."""

    def __init__(self, block, channels):
        self.block, self.channels = block, channels
        self.row_models, self.group_models = Models(), Models()
        self.magnitude_models = Models(self.start_model)
        size = 3 if channels > 6 else channels
        self.groups = [range(first, first + size) for first in range(0, channels, size)]

    def start_model(self, key):
        _, none_before, k = key
        v = 4 * 2 ** (k // 2) * (7 if k & 1 else 5) - 16
        if k >= 14:
            v //= 2
        if none_before and self.channels > 1:
            v += 64
        return Symbols(v, 8)

    def stage(self, expected):
        """The rows of a stage, and which are active. `expected` holds E_0, E_1, E_2 of each."""
        q = np.zeros((len(expected), self.channels), np.int64)
        total = F(2) * (expected[:, 0] + expected[:, 1] + expected[:, 2])
        active = np.ones(len(expected), bool)
        if self.channels > 1:
            classes = magnitude_class(total, 31)
            active = np.array([self.block.decision(self.row_models[k], 1023) for k in classes.tolist()])
        for group in self.groups:
            chosen = np.flatnonzero(active)
            if len(self.groups) > 1:
                chosen = self.chosen(group, chosen, q, magnitude_class(total, 15))
            for channel in group:
                self.magnitudes(group, channel, chosen, q, expected[chosen, channel % 3])
        return q, active

    def chosen(self, group, active, q, classes):
        before = sum_cut(abs(q[active, :group.start]))
        state = np.where(before == 0, 3 * (group == self.groups[-1]), 1 + (2 * before > group.start))
        flags = [self.block.decision(self.group_models[key], 1023)
                 for key in zip(state.tolist(), classes[active].tolist())]
        return active[np.array(flags, bool)]

    def magnitudes(self, group, channel, chosen, q, expected):
        i = channel - group.start
        before = sum_cut(abs(q[chosen, group.start:channel]))
        if i > 0:
            expected = (F(3) * expected + F(before)) * F(1 / (3 + i))
        classes = magnitude_class(expected, 15)
        shifts = np.where(expected == 0, 0, np.clip(np.frexp(expected)[1] - 1 - 2, 0, 30))
        q[chosen, channel] = [self.coefficient((i, t == 0, k), shift) for t, k, shift
                              in zip(before.tolist(), classes.tolist(), shifts.tolist())]

    def coefficient(self, key, shift):
        block = self.block
        value = block.symbol(self.magnitude_models[key])
        if value == 15:
            value += block.gamma()
        value = min(value, (2**31 - 1) >> shift) << shift
        value += block.bits(shift)
        return -value if value and block.bits(1) else value


def sum_cut(magnitudes):
    return np.minimum(magnitudes.sum(1), 2**32 - 1)


def magnitude_class(expected, greatest):
    mantissa, exponent = np.frexp(expected + F(1 / 16))  # mantissa in 1/2 .. 1
    return np.minimum(2 * (exponent - 1 + 4) + (mantissa >= 0.75), greatest)
