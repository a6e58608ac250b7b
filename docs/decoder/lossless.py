"""Integer covariances and exact chunks: format-lossless.md. All arithmetic is on integers."""
import math
from bisect import bisect_left
from collections import defaultdict

import numpy as np

from entropy import Block, Bytes, clamp, decision_models, floor_log2, need
from geometry import axes

F = np.float32

def cut(v):
    return clamp(v, -2**24, 2**24 - 1)

def integer_covariances(data, centres):
    """Log-scales and rotations (section 2). `centres` are in units of half a cell of depth J."""
    data, columns = Bytes(data), []
    bits, ranges, channels = data.number("B"), np.array(data.numbers("14f")).reshape(7, 2), data.varint()
    need(channels == 7 and np.isfinite(ranges).all(), "the integer covariances are not valid")
    for least, greatest in ranges:
        values = np.array(integer_channel(Bytes(data.sized()), centres))
        need(values.min() >= 0 and values.max() < 2**bits, "an integer is out of range")
        columns.append(F(least + values * ((greatest - least) / (2**bits - 1))))
    rotations = np.stack(columns[3:], 1)
    rotations[~rotations.any(1)] = 1, 0, 0, 0
    return np.stack(columns[:3], 1), rotations

def integer_channel(data, centres):
    """2.1."""
    coding, palette = data.number("B"), []
    if coding & 4:
        size = data.varint()
        palette = np.cumsum([data.number("i")] + [data.varint() for _ in range(size - 1)])
    low, width, count = data.number("i"), data.number("B"), len(centres)
    if coding & 3 == 0:
        block = Block(b"")
        block.plain = data.rest()
        values = [(low + block.bits(width) + 2**31) % 2**32 - 2**31 for _ in range(count)]
    elif coding & 3 == 1:
        block = Block(data.rest())
        values = predicted_values(block, low, min(low + 2**width - 1, 2**31 - 1), centres)
    else:
        block, models = Block(data.rest()), decision_models()
        values = [low + block.tree(models, 0, width, 1023) for _ in range(count)]
    block.end()
    return palette[np.clip(values, 0, len(palette) - 1)] if len(palette) else values

def predicted_values(block, low, high, centres):
    """2.2."""
    count, read_residual = len(centres), ResidualReader(block)
    values, residuals, t = [0] * count, [0] * count, 0
    while 4 ** (t + 1) < count:
        t += 1
    order = [(4**t, i) for i in range(0, count, 4**t)]
    for S in (4**u for u in range(t - 1, -1, -1)):
        order += [(S, i) for i in range(0, count, S) if i % (4 * S)]
    for S, i in order:
        candidates = list(range(i - S, -1, -S))[:32]
        if S < 4**t:
            candidates += range(-(-i // (4 * S)) * 4 * S, count, 4 * S)[:16]
        distances = ((centres[candidates] - centres[i]) ** 2).sum(1).clip(max=2**32 - 1)
        nearest = np.argsort(distances, kind="stable")[:12]
        near, weights = [candidates[j] for j in nearest], (2**20 // (distances[nearest] + 8)).clip(min=1).tolist()
        prediction = int((low + high) / 2)
        if near:
            prediction = sum(w * values[j] for w, j in zip(weights, near)) // sum(weights)
        spread = sum(abs(values[j] - prediction) for j in near)
        sizes = [8 * v // max(len(near), 1) for v in (spread, sum(residuals[j] for j in near))]
        residual = read_residual(*map(magnitude_class, sizes))
        residuals[i] = min(abs(residual), 2**32 - 1)
        values[i] = clamp(prediction + residual, low, high)
    return values

class ResidualReader:
    def __init__(self, block):
        self.block, self.mixers = block, defaultdict(lambda: [72000 // 2] * 2)
        self.first, self.second, self.leading, self.sign = (decision_models() for _ in range(4))

    def __call__(self, class_1, class_2):
        node = 1
        for _ in range(6):
            models = self.first[class_1, node], self.second[class_2, node]
            node = 2 * node + self.block.mixed_decision(self.mixers[node], models, 255)
        if node == 64:
            return 0
        magnitude = self.block.below_leading_one(self.leading, min(node - 64, 33))
        return -magnitude if self.block.decision(self.sign[0], 1023) else magnitude

def magnitude_class(v):
    if v == 0:
        return 0
    l = floor_log2(v)
    return min(1 + 2 * l + (l > 0 and 2 * v >= 3 << l), 39)

class Grid:
    """Map of bit patterns to cells (3.1), and the places inside cells (5)."""

    def __init__(self, fields, exact):
        self.exact, self.step, self.zeros = exact, *fields.numbers("2B")

    def cell(self, pattern):
        """The cell, or the stand-in, of a pattern."""
        E, fraction = pattern >> 23 & 255, pattern % 2**23
        if E == 255 and fraction:
            return 0
        e, m = (E, fraction + 2**23) if E else (1, fraction)
        a = 2**24 - 1 if E + self.zeros > self.step else m >> (self.step - e)
        return -1 - a if pattern >> 31 else a

    def pattern(self, q, block, tiny, place):
        """The pattern in a cell. Its place inside the cell is read from the block."""
        sign, a, E, fraction = int(q < 0), -1 - q if q < 0 else q, 0, 0
        if a > 0:
            shift = 23 - floor_log2(a)
            inside = 0 if self.exact else block.bits(max(shift - self.zeros, 0))
            E, fraction = self.step - shift, ((a << shift) + (inside << self.zeros)) % 2**23
        elif not self.exact:
            t, true = self.step - 24, 0
            while true < min(t, 24) and block.decision(tiny[place, true], 255):
                true += 1
            E = min(block.bits(8), t) if true == 24 else t - true
            fraction = block.bits(23)
        return sign << 31 | E << 23 | fraction

class Palette:
    def __init__(self, fields):
        size, key, self.keys = fields.varint(), 0, []
        for _ in range(size):
            key += fields.varint()
            self.keys.append(key)

    def cell(self, pattern):
        return bisect_left(self.keys, pattern ^ (2**32 - 1) if pattern >> 31 else pattern | 2**31)

    def pattern(self, q, block, tiny, place):
        if not self.keys:
            return 0
        key = self.keys[clamp(q, 0, len(self.keys) - 1)]
        return key ^ 2**31 if key >> 31 else key ^ (2**32 - 1)

class Column:
    """Description of a column (4)."""

    def __init__(self, fields, number):
        map_ = fields.number("B")
        self.map = Palette(fields) if map_ == 2 else Grid(fields, map_ == 1)
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

def exact_columns(payload, count, degree):
    """The floats of an exact chunk: a row for each Gaussian, the columns of section 3."""
    fields, patterns, numbers = Bytes(payload), [], []
    ordered, blocks, low = fields.number("B"), fields.varint(), fields.number("B")
    least = [fields.varint() - 2**24 for _ in range(3)]
    means, *columns = [Column(fields, k) for k in (0, *range(3, 11 + 3 * (degree + 1) ** 2))]
    for k in range(blocks):
        rows = count * (k + 1) // blocks - count * k // blocks
        block = Block(fields.sized())
        left, cells = decode_means(block, rows, low, least, means)
        patterns.append(np.hstack([left, RowDecoder(block, columns, np.array(cells)).rows()]))
        numbers += [block.bits((count - 1).bit_length()) for _ in range(rows * ordered)]
        block.end()
    need(fields.at == len(payload), "an exact chunk has bytes left")
    floats = np.vstack(patterns).astype(np.uint32).view(F)
    return floats[np.argsort(numbers)] if ordered else floats

def decode_means(block, rows, low, least, column):
    """Patterns and cells of the means of a block (6)."""
    octave, leading, escape, tiny = (decision_models() for _ in range(4))
    patterns, cells, h, m = [], [], 0, 0
    for _ in range(rows):
        bits = block.tree(octave, h >> 2, 6, 255)
        if bits > 0:
            m = (m + block.below_leading_one(leading, bits)) % 2**63
        h = min((3 * h + 4 * bits + 2) >> 2, 255)
        patterns.append([0] * 3)
        cells.append([0] * 3)
        for k, index in enumerate(axes(m, 21)):
            cells[-1][k] = q = cut(least[k] + (index << low) + block.bits(low))
            if column.has_escapes and block.decision(escape[k], 255):
                patterns[-1][k] = block.bits(32)
            else:
                patterns[-1][k] = column.map.pattern(q, block, tiny, k)
    return patterns, cells

def neighbours(cells, i):
    """Eight of the rows before row i whose means are near (6)."""
    before = np.arange(max(i - 64, 0), i)[::-1]
    nearest = np.argsort(((cells[before] - cells[i]) ** 2).sum(1), kind="stable")[:8]
    return before[nearest].tolist() + [max(i - 1, 0)] * (8 - len(nearest))

class LocalPrediction:
    """7.1."""

    def __init__(self, n):
        self.n, (self.C, self.R, self.L) = n, np.zeros((3, n, n), np.int64)

    def predict(self, c, innovations):
        return clamp(int(self.L[c, :c] @ innovations[:c]) >> 12, -1536, 1536)

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

class KindModels:
    """The models that columns of a kind share (7.2)."""

    def __init__(self):
        self.by_level, self.sign, self.first, self.second = (decision_models() for _ in range(4))
        self.mixers = defaultdict(lambda: [72000 // 4] * 4)

class RowDecoder:
    """The columns of a block behind the means (7)."""

    def __init__(self, block, columns, means):
        self.block, self.columns, self.means, n = block, columns, means, len(columns)
        self.rest, self.level, self.common = np.zeros((3, len(means), n), np.int64)
        self.level[0] = [column.centre for column in columns]
        self.local, self.kinds = LocalPrediction(n), defaultdict(KindModels)
        self.common_models, self.escape_models, self.tiny = (decision_models() for _ in range(3))

    def rows(self):
        return [self.row(i) for i in range(len(self.means))]

    def row(self, i):
        cells, patterns, n = self.means[i].tolist(), [], len(self.columns)
        rows = neighbours(self.means, i)
        weights = np.array([column.neighbour_weights for column in self.columns]).T
        near = ((weights * self.rest[rows]).sum(0) >> 16).tolist()
        X = (self.level[rows[:4]].sum(0) >> 2).tolist()
        z, innovations, slow, fast, sign = np.zeros(n, np.int64), np.zeros(n, np.int64), 0, 0, 0
        for c, column in enumerate(self.columns):
            own, p = column.own(cells), self.local.predict(c, innovations)
            pattern = self.common_or_escape(i, c, column, rows)
            if pattern is None:
                Y, Z = max(column.centre + (slow >> 4), 0), max(column.centre + (fast >> 4), 0)
                error = self.error(self.kinds[column.kind], X[c], Y, Z, sign)
                q = cut(cut(own + near[c] + ((p << column.scale) >> 8)) + error)
                pattern = column.map.pattern(q, self.block, self.tiny, c)
                z[c] = clamp(((q - own - near[c]) * 256) >> column.scale, -1536, 1536)
                innovations[c] = z[c] - p
                level, sign = error_level(abs(error)), (error > 0) - (error < 0)
                slow += (16 * (level - column.centre) - slow) >> 3
                fast += (16 * (level - column.centre) - fast) >> 1
            else:
                q, z[c] = column.map.cell(pattern), p
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
            key = (c, *before, *self.common[rows[:2], c])
            self.common[i, c] = self.block.decision(self.common_models[key], 255)
            if self.common[i, c]:
                return column.common
        if column.has_escapes and self.block.decision(self.escape_models[c], 255):
            return self.block.bits(32)
        return None

    def error(self, kind, X, Y, Z, sign):
        """7.2."""
        block, k = self.block, min(((X + Y + 1) >> 1) >> 2, 26)
        bits = self.error_bits(kind, k, *(clamp(v - 4 * k + 12, 0, 23) for v in (X, Y, Z)))
        if bits == 0:
            return 0
        negative, a, magnitude = block.decision(kind.sign[sign + 1], 1000), clamp(bits - k + 16, 0, 31), 1
        if bits > 1:
            magnitude = 2 + block.decision(kind.first[a], 1000)
        if bits > 2:
            magnitude = 2 * magnitude + block.decision(kind.second[a, magnitude % 2], 1000)
        plain = max(bits - 3, 0)
        magnitude = (magnitude << plain) + block.bits(plain)
        return -magnitude if negative else magnitude

    def error_bits(self, kind, k, x, y, z):
        def more_than(v):
            o = clamp(v - k + 8, 0, 15)
            models = [kind.by_level[key] for key in (("X", x, o), ("Y", y, o), ("XY", x, y, o), ("Z", z, o))]
            return self.block.mixed_decision(kind.mixers[o], models, 400)

        v = k
        if more_than(v):
            v += 1
            while v < 26 and more_than(v):
                v += 1
            return v
        while v > 0 and not more_than(v - 1):
            v -= 1
        return v

def error_level(v):
    if v == 0:
        return 0
    l = floor_log2(v)
    return 4 * (l + 1) + ((4 * v) >> l) % 4
