"""Exact chunks: format.md, section 3; format-lossless.md, sections 2 to 7. All arithmetic is on integers."""
import math
from bisect import bisect_left

import numpy as np

from entropy import Block, Bytes, clamp, floor_log2, learn, need
from geometry import axes

class MixedBlock(Block):
    """An entropy block with mixed decisions (1)."""

    def start_models(self):
        super().start_models()
        self.mixers = {}

    def mixed_decision(self, mixer, keys, limit):
        weights = self.mixers.setdefault(mixer, [72000 // len(keys)] * len(keys))
        models = [self.decisions[key] for key in keys]
        inputs = [STRETCH[clamp(p >> 10, 2, 4094)] for p, _ in models]
        p = squash(sum(weight * x for weight, x in zip(weights, inputs)) >> 16)
        outcome = self.decision_of(p >> 1)
        error = 3 * (65536 * outcome - p)
        for k, x in enumerate(inputs):
            weight = weights[k] + ((x * error + 2**17) >> 18)
            weights[k] = (weight + 2**31) % 2**32 - 2**31
            learn(models[k], outcome, limit)
        return outcome

    def tree(self, key, bits, limit):
        """A number of `bits` bits, by the binary tree of the models (key, node)."""
        node = 1
        for _ in range(bits):
            node = 2 * node + self.decision((key, node), limit)
        return node - 2**bits

    def below_leading_one(self, name, bits):
        """A number of exactly `bits` bits. The first three below the leading one are modelled."""
        modelled = min(bits - 1, 3)
        head, plain = 2**modelled + self.tree((name, bits), modelled, 255), bits - 1 - modelled
        return (head << plain) + self.bits(plain)

def squash(x):
    return SQUASH[clamp(x, -2047, 2047) + 2047]

def squash_table():
    upper, e = [], 2**40
    for _ in range(2048):
        upper.append(min((65536 * e + (2**40 + e) // 2) // (2**40 + e), 65504))
        e = (e * 4629735647166717428) >> 62
    return [65536 - value for value in upper[:0:-1]] + upper

SQUASH = squash_table()
STRETCH = [min(bisect_left(SQUASH, 16 * q + 8) - 2047, 2047) for q in range(4095)]

def cut(v):
    return clamp(v, -2**24, 2**24 - 1)

class Column:
    """A column: its description (3), its map (2.1)."""

    def __init__(self, fields, number):
        self.number, self.map = number, fields.number("B")
        if self.map == 2:
            self.keys = np.cumsum([fields.varint() for _ in range(fields.varint())]).tolist()
        else:
            self.step, self.zeros = fields.numbers("2B")
        flags = fields.number("B")
        self.has_escapes, self.has_common = flags & 1, flags & 2
        self.common = fields.number("I") if self.has_common else 0
        if number > 0:
            self.kind = 4 + (number - 11) % 3 if number >= 14 else (0, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3)[number - 3]
            self.centre, self.shift = fields.numbers("2B")
            self.scale = max((self.centre >> 2) - 1, 0)
            self.bias, count = fields.zigzag(), fields.number("B")
            self.weights = [(fields.number("B"), fields.zigzag()) for _ in range(count)]
            self.neighbour_weights = [fields.zigzag() for _ in range(8)]

    def own(self, cells):
        value = self.bias + sum(weight * cells[column] for column, weight in self.weights)
        return cut(((value + 2**63) % 2**64 - 2**63) >> self.shift)

    def cell(self, pattern):
        """The cell, or the stand-in, of a pattern."""
        if self.map == 2:
            return bisect_left(self.keys, pattern ^ (2**32 - 1 if pattern >> 31 else 2**31))
        E, fraction = pattern >> 23 & 255, pattern % 2**23
        if E == 255 and fraction:
            return 0
        e, m = (E, fraction + 2**23) if E else (1, fraction)
        a = 2**24 - 1 if E + self.zeros > self.step else m >> (self.step - e)
        return -1 - a if pattern >> 31 else a

    def pattern(self, q, block, axis=0):
        """The pattern in a cell. Its place inside the cell is read from the block (4)."""
        if self.map == 2:
            key = self.keys[clamp(q, 0, len(self.keys) - 1)] if self.keys else 2**31
            return key ^ (2**31 if key >> 31 else 2**32 - 1)
        a, E, fraction = -1 - q if q < 0 else q, 0, 0
        if a > 0:
            shift = 23 - floor_log2(a)
            inside = block.bits(max(shift - self.zeros, 0)) if self.map == 0 else 0
            E, fraction = self.step - shift, ((a << shift) + (inside << self.zeros)) % 2**23
        elif self.map == 0:
            t, true = self.step - 24, 0
            while true < min(t, 24) and block.decision(("tiny", self.number, axis, true), 255):
                true += 1
            E = min(block.bits(8), t) if true == 24 else t - true
            fraction = block.bits(23)
        return (q < 0) << 31 | E << 23 | fraction

def exact_columns(payload, count, degree):
    """The floats of an exact chunk: a row for each Gaussian, the columns of section 2."""
    fields, patterns, numbers, width = Bytes(payload), [], [], 11 + 3 * (degree + 1) ** 2
    form = fields.number("B")
    if form == 0:
        floats = np.array(fields.numbers(f"{count * width}f"), np.float32).reshape(count, width)
        need(not fields.read(), "an exact chunk has bytes left")
        return floats
    ordered, blocks, low = form == 2, fields.varint(), fields.number("B")
    least = [fields.varint() - 2**24 for _ in range(3)]
    means, *columns = [Column(fields, k) for k in (0, *range(3, width))]
    for k in range(blocks):
        rows = count * (k + 1) // blocks - count * k // blocks
        block = MixedBlock(fields.sized())
        left, cells = decode_means(block, rows, low, least, means)
        decoder = RowDecoder(block, columns, np.array(cells))
        patterns.append(np.hstack([left, [decoder.row(i) for i in range(rows)]]))
        numbers += [block.bits((count - 1).bit_length()) for _ in range(rows * ordered)]
        block.end()
    need(not fields.read(), "an exact chunk has bytes left")
    floats = np.vstack(patterns).astype(np.uint32).view(np.float32)
    return floats[np.argsort(numbers)] if ordered else floats

def decode_means(block, rows, low, least, column):
    """Patterns and cells of the means of a block (5)."""
    patterns, cells, h, m = [], [], 0, 0
    for _ in range(rows):
        bits = block.tree(("octave", h >> 2), 6, 255)
        if bits > 0:
            m = (m + block.below_leading_one("leading", bits)) % 2**63
        h = min((3 * h + 4 * bits + 2) >> 2, 255)
        cells.append([])
        patterns.append([])
        for k, index in enumerate(axes(m, 21)):
            q = cut(least[k] + (index << low) + block.bits(low))
            escape = column.has_escapes and block.decision(("escape", 0, k), 255)
            patterns[-1].append(block.bits(32) if escape else column.pattern(q, block, k))
            cells[-1].append(q)
    return patterns, cells

def neighbours(cells, i):
    """Eight of the rows before row i whose means are near (5)."""
    before = np.arange(max(i - 64, 0), i)[::-1]
    nearest = np.argsort(((cells[before] - cells[i]) ** 2).sum(1), kind="stable")[:8]
    return before[nearest].tolist() + [max(i - 1, 0)] * (8 - len(nearest))

class LocalPrediction:
    """6.1."""

    def __init__(self, n):
        self.n, (self.C, self.R, self.L) = n, np.zeros((3, n, n), np.int64)

    def end_row(self, row, z):
        gain = 65536 // (math.isqrt(int(z @ z) // self.n + 16384) + 1)
        z = (z * gain) >> 8
        self.R += np.outer(z, z)
        if row % 32 == 31:
            self.C += self.R - (self.C >> 3)
            self.R[:] = 0
            self.find_factors()

    def find_factors(self):
        L, D = self.L, [0] * self.n
        for c in range(self.n):
            s = np.zeros(c, np.int64)
            for j in range(c):
                s[j] = clamp(int(self.C[c, j]) - (int(s[:j] @ L[j, :j]) >> 12), -2**36, 2**36)
                L[c, j] = np.sign(s[j]) * min(abs(int(s[j])) * 4096 // D[j], 8192)
            D[c] = max(int(self.C[c, c]) + 393216 - (int(s @ L[c, :c]) >> 12), 196608)

class RowDecoder:
    """The columns of a block behind the means (6)."""

    def __init__(self, block, columns, means):
        self.block, self.columns, self.means, n = block, columns, means, len(columns)
        self.rest, self.level, self.common = np.zeros((3, len(means), n), np.int64)
        self.level[0] = [column.centre for column in columns]
        self.local = LocalPrediction(n)

    def row(self, i):
        cells, patterns, n = self.means[i].tolist(), [], len(self.columns)
        rows = neighbours(self.means, i)
        weights = np.array([column.neighbour_weights for column in self.columns]).T
        near = ((weights * self.rest[rows]).sum(0) >> 16).tolist()
        X = (self.level[rows[:4]].sum(0) >> 2).tolist()
        z, innovations, L, slow, fast, sign = *np.zeros((2, n), np.int64), self.local.L, 0, 0, 0
        for c, column in enumerate(self.columns):
            own, p = column.own(cells), clamp(int(L[c, :c] @ innovations[:c]) >> 12, -1536, 1536)
            pattern = self.common_or_escape(i, c, column, rows)
            if pattern is None:
                Y, Z = max(column.centre + (slow >> 4), 0), max(column.centre + (fast >> 4), 0)
                error = self.error(column.kind, X[c], Y, Z, sign)
                q = cut(cut(own + near[c] + ((p << column.scale) >> 8)) + error)
                pattern = column.pattern(q, self.block)
                z[c] = clamp(((q - own - near[c]) * 256) >> column.scale, -1536, 1536)
                innovations[c] = z[c] - p
                level, sign = error_level(abs(error)), (error > 0) - (error < 0)
                slow += (16 * (level - column.centre) - slow) >> 3
                fast += (16 * (level - column.centre) - fast) >> 1
            else:
                q, z[c] = column.cell(pattern), p
                level, sign = clamp(column.centre + (slow >> 4), 0, 120), 0
            self.rest[i, c], self.level[i, c] = q - own, level
            cells.append(q)
            patterns.append(pattern)
        self.local.end_row(i, z)
        return patterns

    def common_or_escape(self, i, c, column, rows):
        """The pattern of a common value or an escape, None of another value."""
        if column.has_common:
            before = [self.common[i, c - k] if c >= k else 0 for k in (3, 1)]
            key = ("common", c, *before, *self.common[rows[:2], c])
            self.common[i, c] = self.block.decision(key, 255)
            if self.common[i, c]:
                return column.common
        escape = column.has_escapes and self.block.decision(("escape", c + 3), 255)
        return self.block.bits(32) if escape else None

    def error(self, kind, X, Y, Z, sign):
        """6.2."""
        block, k = self.block, min(((X + Y + 1) >> 1) >> 2, 26)
        bits = self.error_bits(kind, k, *(clamp(v - 4 * k + 12, 0, 23) for v in (X, Y, Z)))
        if bits == 0:
            return 0
        negative, a, magnitude = block.decision(("sign", kind, sign), 1000), clamp(bits - k + 16, 0, 31), 1
        if bits > 1:
            magnitude = 2 + block.decision(("first", kind, a), 1000)
        if bits > 2:
            magnitude = 2 * magnitude + block.decision(("second", kind, a, magnitude), 1000)
        plain = max(bits - 3, 0)
        magnitude = (magnitude << plain) + block.bits(plain)
        return -magnitude if negative else magnitude

    def error_bits(self, kind, k, x, y, z):
        def more_than(v):
            o = clamp(v - k + 8, 0, 15)
            keys = ("X", kind, x, o), ("Y", kind, y, o), ("XY", kind, x, y, o), ("Z", kind, z, o)
            return self.block.mixed_decision((kind, o), keys, 400)

        if more_than(k):
            return next((v for v in range(k + 1, 26) if not more_than(v)), max(k + 1, 26))
        return next((v + 1 for v in range(k - 1, -1, -1) if more_than(v)), 0)

def error_level(v):
    bits = v.bit_length()
    return 4 * bits + ((8 * v) >> bits) % 4
