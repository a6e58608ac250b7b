"""Integer covariances and exact chunks: format-lossless.md. All arithmetic is on integers."""
import math
from bisect import bisect_left

import numpy as np

from entropy import Block, Bytes, Models, clamp, need

F = np.float32
CELLS = 2**24


def cut(v):
    return clamp(v, -CELLS, CELLS - 1)


# Integer covariances: section 2.

def integer_covariances(data, centres):
    """Log-scales and rotations. `centres` are in units of half a cell of the greatest depth."""
    data = Bytes(data)
    bits = data.number("B")
    need(8 <= bits <= 24, "a width of integers is out of range")
    ranges = np.array(data.numbers("14f")).reshape(7, 2)
    need(np.isfinite(ranges).all(), "a range is not finite")
    need(data.varint() == 7, "a covariance has 7 channels")
    columns = []
    for least, greatest in ranges:
        values = np.array(integer_channel(Bytes(data.sized()), centres))
        need(values.min() >= 0 and values.max() < 2**bits, "an integer is out of range")
        columns.append(F(least + values * ((greatest - least) / (2**bits - 1))))
    rotations = np.stack(columns[3:], 1)
    rotations[(rotations == 0).all(1)] = 1, 0, 0, 0
    w, x, y, z = (rotations * rotations).T
    norm = w + x + y + z
    need((np.isfinite(norm) & (norm >= F(2.0**-126))).all(), "a quaternion has no length")
    return np.stack(columns[:3], 1), rotations


def integer_channel(data, centres):
    coding, palette = data.number("B"), None
    need(coding & ~4 <= 2, "an unknown coding of integers")
    if coding & 4:
        size, palette = data.varint(), [data.number("i")]
        need(1 <= size <= 4096, "a palette has a bad size")
        for _ in range(size - 1):
            palette.append(palette[-1] + data.varint())
        need(palette[-1] < 2**31, "a palette goes beyond 32 bits")
    low, width = data.number("i"), data.number("B")
    need(width <= (12 if coding & 3 == 2 else 32), "a width is out of range")
    block, count = Block(b""), len(centres)
    if coding & 3 == 0:
        block.plain = data.rest()
        values = [(low + block.bits(width) + 2**31) % 2**32 - 2**31 for _ in range(count)]
    else:
        block = Block(data.rest())
        if coding & 3 == 2:
            models = Models()
            values = [low + block.tree(models, 0, width, 1023) for _ in range(count)]
        else:
            values = predicted_values(block, low, min(low + 2**width - 1, 2**31 - 1), centres)
    block.end()
    return [palette[clamp(v, 0, len(palette) - 1)] for v in values] if palette else values


def predicted_values(block, low, high, centres):
    """2.2."""
    count, residual_decoder = len(centres), ResidualDecoder(block)
    values, residuals = [0] * count, [0] * count
    t = 0
    while 4 ** (t + 1) < count:
        t += 1
    for u in range(t, -1, -1):
        S = 4**u
        for i in range(0, count, S):
            if u < t and i % (4 * S) == 0:
                continue
            candidates = list(range(i - S, -1, -S))[:32]
            if u < t:
                candidates += range(-(-i // (4 * S)) * 4 * S, count, 4 * S)[:16]
            distances = ((centres[candidates] - centres[i]) ** 2).sum(1).clip(max=2**32 - 1)
            nearest = np.argsort(distances, kind="stable")[:12]
            kept = [candidates[j] for j in nearest]
            weights = [max(2**20 // (d + 8), 1) for d in distances[nearest].tolist()]
            if kept:
                prediction = sum(w * values[j] for w, j in zip(weights, kept)) // sum(weights)
            else:
                prediction = int((low + high) / 2)
            k = max(len(kept), 1)
            spread = 8 * sum(abs(values[j] - prediction) for j in kept) // k
            residual = residual_decoder.next(spread, 8 * sum(residuals[j] for j in kept) // k)
            residuals[i] = min(abs(residual), 2**32 - 1)
            values[i] = clamp(prediction + residual, low, high)
    return values


class ResidualDecoder:
    def __init__(self, block):
        self.block, self.first, self.second, self.leading, self.sign = block, Models(), Models(), Models(), Models()
        self.mixers = Models(lambda node: [36000] * 2)

    def next(self, e1, e2):
        c1, c2, node = magnitude_class(e1), magnitude_class(e2), 1
        for _ in range(6):
            models = [self.first[c1, node], self.second[c2, node]]
            node = 2 * node + self.block.mixed_decision(self.mixers[node], models, 255)
        bits = min(node - 64, 33)
        if bits == 0:
            return 0
        magnitude = self.block.below_leading_one(self.leading, bits)
        return -magnitude if self.block.decision(self.sign[0], 1023) else magnitude


def magnitude_class(v):
    if v == 0:
        return 0
    l = v.bit_length() - 1
    return min(1 + 2 * l + (l > 0 and 2 * v >= 3 << l), 39)


# Maps of bit patterns to cells: sections 3.1 and 5.

class Grid:
    def __init__(self, fields, exact):
        self.exact, self.step, self.zeros = exact, fields.number("B"), fields.number("B")
        need(24 <= self.step <= 254 and self.zeros <= (0 if exact else 22), "a grid is not valid")
        self.tiny = Models()

    def new_models(self):
        self.tiny = Models()

    def cell(self, pattern):
        """The cell, or the stand-in, of a pattern."""
        E, fraction = pattern >> 23 & 255, pattern & (2**23 - 1)
        if E + self.zeros > self.step:
            if E == 255 and fraction:
                return 0
            a = CELLS - 1
        else:
            e, m = (E, fraction + 2**23) if E else (1, fraction)
            a = m >> (self.step - e)
        return -1 - a if pattern >> 31 else a

    def pattern(self, q, block):
        """The pattern in a cell. Its place inside the cell is read from the block."""
        sign, a = (1, -1 - q) if q < 0 else (0, q)
        if a == 0:
            E, fraction = (0, 0) if self.exact else self.tail_of_zero(block)
        else:
            shift = 24 - a.bit_length()
            inside = 0 if self.exact else block.bits(max(shift - self.zeros, 0))
            E, fraction = self.step - shift, ((a << shift) + (inside << self.zeros)) % 2**23
        return sign << 31 | E << 23 | fraction

    def tail_of_zero(self, block):
        t, true = self.step - 24, 0
        while true < min(t, 24) and block.decision(self.tiny[true], 255):
            true += 1
        E = min(block.bits(8), t) if true == 24 else t - true
        return E, block.bits(23)


class Palette:
    def __init__(self, fields):
        size, key = fields.varint(), 0
        need(size <= 65536, "a palette is too large")
        self.keys = []
        for _ in range(size):
            key += fields.varint()
            self.keys.append(key)
        need(key < 2**32, "a key of a palette is too large")

    def new_models(self):
        pass

    def cell(self, pattern):
        return bisect_left(self.keys, pattern ^ (2**32 - 1) if pattern >> 31 else pattern | 2**31)

    def pattern(self, q, block):
        if not self.keys:
            return 0
        key = self.keys[clamp(q, 0, len(self.keys) - 1)]
        return key ^ 2**31 if key >> 31 else key ^ (2**32 - 1)


# Exact chunks: sections 4, 6 and 7.

class Column:
    """Description of a column (section 4)."""

    def __init__(self, fields, number):
        map_ = fields.number("B")
        need(map_ <= 2, "an unknown map")
        self.map = Palette(fields) if map_ == 2 else Grid(fields, map_ == 1)
        flags = fields.number("B")
        need(flags <= 3, "unknown flags of a column")
        self.has_escapes = bool(flags & 1)
        self.common = fields.number("I") if flags & 2 else None
        if number == 0:
            return
        self.kind = 4 + (number - 11) % 3 if number >= 14 else (0, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3)[number - 3]
        self.centre, self.shift = fields.numbers("2B")
        need(self.centre <= 120 and self.shift <= 36, "a column is not valid")
        self.bias, self.weights = fields.zigzag(), []
        for _ in range(fields.number("B")):
            self.weights.append((fields.number("B"), fields.zigzag()))
            need(self.weights[-1][0] < number, "a column is predicted from a later one")
        self.neighbour_weights = [fields.zigzag() for _ in range(8)]
        need(all(-2**31 <= w < 2**31 for w in [w for _, w in self.weights] + self.neighbour_weights),
             "a weight is too large")
        self.scale = max((self.centre >> 2) - 1, 0)

    def own(self, cells):
        value = self.bias + sum(weight * cells[column] for column, weight in self.weights)
        return cut(((value + 2**63) % 2**64 - 2**63) >> self.shift)


def exact_columns(payload, count, degree):
    """The floats of an exact chunk, one row for each Gaussian and one column as in section 3."""
    need(count <= 512 * len(payload), "too many Gaussians for the payload")
    fields, width = Bytes(payload), 11 + 3 * (degree + 1) ** 2
    ordered, blocks, low = fields.number("B"), fields.varint(), fields.number("B")
    need(ordered <= 1 and blocks == -(-count // 65536) and low <= 4, "the payload is not valid")
    least = [fields.varint() - CELLS for _ in range(3)]
    need(max(least) < CELLS, "a least cell is out of range")
    mean_column = Column(fields, 0)
    columns = [Column(fields, number) for number in range(3, width)]
    patterns, numbers = [], []
    for k in range(blocks):
        rows = count * (k + 1) // blocks - count * k // blocks
        data = fields.sized()
        need(rows <= 512 * len(data) + 64, "too many rows for a block")
        block = Block(data)
        means, cells = decode_means(block, rows, low, least, mean_column)
        rest = RowDecoder(block, columns).decode(cells)
        patterns += [a + b for a, b in zip(means, rest)]
        if ordered:
            numbers += [block.bits((count - 1).bit_length()) for _ in range(rows)]
        block.end()
    need(fields.at == len(payload), "the payload has bytes left")
    floats = np.array(patterns, np.uint32).view(F)
    if not ordered:
        return floats
    need(sorted(numbers) == list(range(count)), "the order is not a permutation")
    result = np.empty_like(floats)
    result[numbers] = floats
    return result


def decode_means(block, rows, low, least, column):
    """Patterns and cells of the means of a block (section 6)."""
    octave, leading, escape = Models(), Models(), Models()
    tiny = [Models() for _ in range(3)]
    patterns, cells, h, m = [], [], 0, 0
    for _ in range(rows):
        bits = block.tree(octave, h >> 2, 6, 255)
        if bits:
            m = (m + block.below_leading_one(leading, bits)) % 2**63
        h = min((3 * h + 4 * bits + 2) >> 2, 255)
        patterns.append([])
        cells.append([])
        for axis in range(3):
            index = sum((m >> (3 * i + 2 - axis) & 1) << i for i in range(21))
            q = cut(least[axis] + (index << low) + block.bits(low))
            cells[-1].append(q)
            if column.has_escapes and block.decision(escape[axis], 255):
                patterns[-1].append(block.bits(32))
            else:
                column.map.tiny = tiny[axis]
                patterns[-1].append(column.map.pattern(q, block))
    return patterns, cells


def neighbours(cells, i):
    """Section 6: eight rows before row i whose means are near."""
    before = np.arange(max(i - 64, 0), i)[::-1]
    distances = ((cells[before] - cells[i]) ** 2).sum(1)
    near = before[np.argsort(distances, kind="stable")[:8]].tolist()
    return near + [max(i - 1, 0)] * (8 - len(near))


class LocalPrediction:
    """7.1."""

    def __init__(self, n):
        self.C, self.R, self.L = (np.zeros((n, n), np.int64) for _ in range(3))
        self.n = n

    def end_row(self, row, z):
        gain = 65536 // (math.isqrt(int((z * z).sum()) // self.n + 16384) + 1)
        z = (z * gain) >> 8
        self.R += np.outer(z, z)
        if row % 32 == 31:
            self.C += self.R - (self.C >> 3)
            self.R[:] = 0
            self.factorise()

    def factorise(self):
        D = [0] * self.n
        for c in range(self.n):
            s = np.zeros(c, np.int64)
            for j in range(c):
                s[j] = clamp(int(self.C[c, j] - ((s[:j] @ self.L[j, :j]) >> 12)), -2**36, 2**36)
                quotient = abs(int(s[j])) * 4096 // D[j]
                self.L[c, j] = min(quotient, 8192) * (-1 if s[j] < 0 else 1)
            D[c] = max(int(self.C[c, c]) + 393216 - (int(s @ self.L[c, :c]) >> 12), 196608)


class KindModels:
    """The models that columns of a kind share (7.2)."""

    def __init__(self):
        self.tables = [Models() for _ in range(4)]
        self.mixers = Models(lambda o: [18000] * 4)
        self.sign, self.first, self.second = Models(), Models(), Models()


class RowDecoder:
    """The columns of a block behind the means (section 7)."""

    def __init__(self, block, columns):
        self.block, self.columns, self.n = block, columns, len(columns)
        self.kinds = Models(lambda kind: KindModels())
        self.common_models, self.escape_models = Models(), Models()
        for column in columns:
            column.map.new_models()

    def decode(self, mean_cells):
        rows, n = len(mean_cells), self.n
        means = np.array(mean_cells).reshape(rows, 3)
        self.rest, self.level = np.zeros((rows, n), np.int64), np.zeros((rows, n), np.int64)
        self.common = np.zeros((rows, n), bool)
        self.level[0] = [column.centre for column in self.columns]
        self.local = LocalPrediction(n)
        weights = np.array([column.neighbour_weights for column in self.columns]).T
        patterns = []
        for i in range(rows):
            near_rows = neighbours(means, i)
            near = (weights * self.rest[near_rows]).sum(0) >> 16
            patterns.append(self.row(i, mean_cells[i], near_rows, near.tolist()))
        return patterns

    def row(self, i, cells, near_rows, near):
        cells, patterns = list(cells), []
        level_sums = self.level[near_rows[:4]].sum(0).tolist()
        common_near = self.common[near_rows[:2]].astype(int).tolist()
        z, innovations = np.zeros(self.n, np.int64), np.zeros(self.n, np.int64)
        common, slow, fast, sign = [0] * self.n, 0, 0, 0
        for c, column in enumerate(self.columns):
            own = column.own(cells)
            p = clamp(int(self.local.L[c, :c] @ innovations[:c]) >> 12, -1536, 1536)
            context = (c, c >= 3 and common[c - 3], c >= 1 and common[c - 1], common_near[0][c], common_near[1][c])
            pattern = self.common_or_escape(c, column, common, context)
            if pattern is not None:
                q, z[c], sign = column.map.cell(pattern), p, 0
                level = clamp(column.centre + (slow >> 4), 0, 120)
            else:
                prediction = cut(own + near[c] + ((p << column.scale) >> 8))
                error = self.error(column, level_sums[c] >> 2, slow, fast, sign)
                q = cut(prediction + error)
                pattern = column.map.pattern(q, self.block)
                level = error_level(error)
                slow += (16 * (level - column.centre) - slow) >> 3
                fast += (16 * (level - column.centre) - fast) >> 1
                sign = (error > 0) - (error < 0)
                z[c] = clamp(((q - own - near[c]) * 256) >> column.scale, -1536, 1536)
                innovations[c] = z[c] - p
            self.rest[i, c], self.level[i, c] = q - own, level
            cells.append(q)
            patterns.append(pattern)
        self.common[i] = common
        self.local.end_row(i, z)
        return patterns

    def common_or_escape(self, c, column, common, context):
        """The pattern of a common value or of an escape; None for another value. Sets common[c]."""
        if column.common is not None and self.block.decision(self.common_models[context], 255):
            common[c] = 1
            return column.common
        if column.has_escapes and self.block.decision(self.escape_models[c], 255):
            return self.block.bits(32)
        return None

    def error(self, column, X, slow, fast, sign):
        """7.2."""
        block, models = self.block, self.kinds[column.kind]
        Y, Z = max(column.centre + (slow >> 4), 0), max(column.centre + (fast >> 4), 0)
        k = min(((X + Y + 1) >> 1) >> 2, 26)
        bits = self.error_bits(models, k, *(clamp(v - 4 * k + 12, 0, 23) for v in (X, Y, Z)))
        if bits == 0:
            return 0
        negative = block.decision(models.sign[sign + 1], 1000)
        a, magnitude = clamp(bits - k + 16, 0, 31), 1
        if bits > 1:
            magnitude = 2 + block.decision(models.first[a], 1000)
        if bits > 2:
            magnitude = 2 * magnitude + block.decision(models.second[2 * a + (magnitude & 1)], 1000)
        plain = max(bits - 3, 0)
        magnitude = (magnitude << plain) + block.bits(plain)
        return -magnitude if negative else magnitude

    def error_bits(self, models, k, x, y, z):
        def more_than(v):
            o = clamp(v - k + 8, 0, 15)
            mixed = [table[key] for table, key in zip(models.tables, ((x, o), (y, o), (x, y, o), (z, o)))]
            return self.block.mixed_decision(models.mixers[o], mixed, 400)

        if more_than(k):
            v = k + 1
            while v < 26 and more_than(v):
                v += 1
            return v
        v = k - 1
        while v >= 0 and not more_than(v):
            v -= 1
        return v + 1


def error_level(error):
    v = abs(error)
    if v == 0:
        return 0
    l = v.bit_length() - 1
    return 4 * (l + 1) + ((4 * v) >> l & 3)
