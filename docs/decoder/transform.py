"""RAHT and the coding of its coefficients: format.md, section 7."""
import numpy as np

from entropy import floor_log2, unfold
from trace import note, note_rows

F = np.float32

class Merges:
    """The merges of a chunk (7.1). Entry 0 of the arrays stands for no merge."""

    def __init__(self, codes):
        self.count = n = len(codes)
        bit = [64] + [floor_log2(a ^ b) for a, b in zip(codes, codes[1:])] + [64]
        self.first, self.last, self.parent = np.zeros((3, n), np.int64)
        open_ = [0]  # merges whose right side has not ended, with falling bits
        for j in range(1, n + 1):
            while bit[open_[-1]] < bit[j]:
                self.last[open_.pop()] = j
            if j < n:
                self.first[j] = open_[-1]
                open_.append(j)
        for j in range(1, n):
            before, behind = self.first[j], self.last[j]
            self.parent[j] = before if bit[before] < bit[behind] else behind % n
        bits = np.array(bit[:n])
        self.stages = [np.flatnonzero(bits == b) for b in range(62, -1, -1) if b in bits]

class Raht:
    """Decodes the attributes of a chunk, for one weight per leaf."""

    def __init__(self, block, merges, weights):
        self.block, self.merges = block, merges
        first, last, j = merges.first, merges.last, np.arange(merges.count)
        weights = np.array(weights, np.float64)
        sums, squares = (np.add.accumulate(np.append(0.0, v)) for v in (weights, weights * weights))
        self.total = sums[-1]
        w1, w2 = sums[j] - sums[first], sums[last] - sums[j]
        s1, s2 = squares[j] - squares[first], squares[last] - squares[j]
        inverse = (w1 + w2) / (w1 * w2)
        self.share, self.scale = F(w2 / (w1 + w2)), F(np.sqrt(inverse))
        self.gain = F(np.sqrt((s1 / (w1 * w1) + s2 / (w2 * w2)) / inverse))

    def attribute(self, channels, step):
        """The values, one row per leaf and one column per channel (7.3, 7.6)."""
        merges, step = self.merges, F(step)
        self.block.start_models()
        values, activity = np.zeros((merges.count, channels), F), np.zeros((merges.count, 3), F)
        coefficients = np.zeros((merges.count, channels), np.int64)
        values[0] = [F(unfold(self.block.gamma()) * np.float64(step) / np.sqrt(self.total))
                     for _ in range(channels)]
        rows = Rows(self.block, channels)
        half_mean = F([0.5 / max(len(range(a, channels, 3)), 1) for a in range(3)])
        for stage in merges.stages:
            gain, scale, share = (v[stage, None] for v in (self.gain, self.scale, self.share))
            inherited, left = activity[merges.parent[stage]], merges.first[stage]
            q, active = rows.of_stage(inherited * gain)
            coefficients[stage] = q
            sums = np.stack([sum_cut(abs(q[:, a::3])) for a in range(3)], 1)
            activity[stage] = inherited * F(0.5) + F(sums) * (half_mean * (F(1) / gain))
            d = F(q) * step * scale
            moved = values[left] - d * share
            values[stage] = np.where(active, moved + d, values[left])  # leaf j begins the right side
            values[left] = np.where(active, moved, values[left])
        note(f"attribute of {channels} channels, step {step}")
        note_rows("coefficients of visited merge", coefficients[np.concatenate(merges.stages or [[]]).astype(int)])
        note_rows("values of leaf", values)
        return values

class Rows:
    """The coefficients of an attribute, stage by stage (7.4, 7.5)."""

    def __init__(self, block, channels):
        self.block, self.channels = block, channels
        size = 3 if channels > 6 else channels
        self.groups = [range(first, first + size) for first in range(0, channels, size)]

    def of_stage(self, expected):
        """The rows, and a column that says which are active. `expected` has E_0, E_1, E_2 of each."""
        q, active = np.zeros((len(expected), self.channels), np.int64), np.ones(len(expected), bool)
        total = F(2) * (expected[:, 0] + expected[:, 1] + expected[:, 2])
        if self.channels > 1:
            active = self.flags("row", magnitude_class(total))
        for group in self.groups:
            chosen = np.flatnonzero(active)
            if len(self.groups) > 1:
                before = sum_cut(abs(q[chosen, :group.start]))
                state = np.where(before == 0, 3 * (group == self.groups[-1]), 1 + (2 * before > group.start))
                chosen = chosen[self.flags("group", 16 * state + magnitude_class(total[chosen]))]
            for channel in group:
                before = sum_cut(abs(q[chosen, group.start:channel]))
                q[chosen, channel] = self.magnitudes(channel - group.start, before, expected[chosen, channel % 3])
        return q, active[:, None]

    def flags(self, name, keys):
        return np.array([self.block.decision((name, key), 1023) for key in keys.tolist()], bool)

    def magnitudes(self, i, before, expected):
        """A pass over the chosen rows. `before` is `t` of each row, `expected` is E_a."""
        if i > 0:
            expected = (F(3) * expected + F(before)) * F(1 / (3 + i))
        shifts = np.where(expected == 0, 0, np.clip(np.frexp(expected)[1] - 1 - 2, 0, 30))
        rows = zip((before > 0).tolist(), magnitude_class(expected).tolist(), shifts.tolist())
        return [self.coefficient(i if len(self.groups) > 1 else 0, *row) for row in rows]

    def coefficient(self, g, z, k, shift):
        v = 4 * 2 ** (k // 2) * (7 if k % 2 else 5) - 16
        v = v // 2 if k >= 14 else v
        v = v + 64 if z == 0 and self.channels > 1 else v
        value = self.block.symbol(("magnitude", g, z, k), v, 8)
        if value == 15:
            value += self.block.gamma()
        value = (min(value, (2**31 - 1) >> shift) << shift) + self.block.bits(shift)
        return -value if value and self.block.bits(1) else value

def sum_cut(magnitudes):
    return np.minimum(magnitudes.sum(1), 2**32 - 1)

def magnitude_class(expected):
    mantissa, exponent = np.frexp(expected + F(1 / 16))  # the mantissa is in 0.5 .. 1
    return np.minimum(2 * (exponent - 1 + 4) + (mantissa >= 0.75), 15)
