"""Covariances as integers (mode 1) or by a codebook (mode 2): format-lossless.md, sections 2 and 3."""
import numpy as np

from entropy import Block, Bytes, clamp, need

F = np.float32
NO_SYMBOLS = b"\0" + b"\0\0\1\0" * 4  # begins an entropy block that has only plain bits

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
    block = Block((NO_SYMBOLS if coding & 3 == 0 else b"") + data.read())
    if coding & 3 == 0:
        values = [(low + block.bits(width) + 2**31) % 2**32 - 2**31 for _ in range(count)]
    elif coding & 3 == 1:
        values = predicted_values(block, low, min(low + 2**width - 1, 2**31 - 1), centres)
    else:
        values = [low + block.tree("histogram", width, 1023) for _ in range(count)]
    block.end()
    return palette[np.clip(values, 0, len(palette) - 1)] if len(palette) else values

def predicted_values(block, low, high, centres):
    """2.2."""
    count, t = len(centres), 0
    values, residuals = [0] * count, [0] * count
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
        residual = read_residual(block, *map(magnitude_class, sizes))
        residuals[i] = min(abs(residual), 2**32 - 1)
        values[i] = clamp(prediction + residual, low, high)
    return values

def read_residual(block, class_1, class_2):
    node = 1
    for _ in range(6):
        keys = ("first", class_1, node), ("second", class_2, node)
        node = 2 * node + block.mixed_decision(node, keys, 255)
    if node == 64:
        return 0
    magnitude = block.below_leading_one("residual", min(node - 64, 33))
    return -magnitude if block.decision("sign", 1023) else magnitude

def magnitude_class(v):
    """B(v) of 2.2, where `bits` is l + 1."""
    bits = v.bit_length()
    return clamp(2 * bits - 1 + ((4 * v) >> bits) % 2, 0, 39)

class Codebook:
    """The codewords of mode 2, one to a row (3)."""

    def __init__(self, data):
        data = Bytes(data)
        r, s, self.size = data.number("B"), data.number("B"), data.varint()
        words = self.words(Block(data.read()))
        x, y, z = words[:, :3].T * (0.198912367379658 / (2 ** (r - 1) - 1))
        n = x * x + y * y + z * z
        i = 1 / (1 + n)
        self.rotations = F(np.stack([(1 - n) * i, x * (2 * i), y * (2 * i), z * (2 * i)], 1))
        self.log_scales = F(0 - words[:, 3:] / 2**s)

    def words(self, block):
        words, last_class = [[0] * 6], [0] * 6
        for _ in range(self.size):
            words.append(list(words[-1]))
            for k in range(6):
                b = block.symbol((k, last_class[k]), 256, 2)
                last_class[k] = (b > 0) + (b > 2) + (b > 5)
                if b > 0:
                    magnitude = 2 ** (b - 1) + block.bits(b - 1)
                    words[-1][k] += -magnitude if block.bits(1) else magnitude
        block.end()
        return np.array(words[1:])

    def covariances(self, block, log_factors):
        """Log-scales and rotations of mode 2."""
        bits, last, indices = (self.size - 1).bit_length(), 0, []
        block.start_models()
        for _ in log_factors:
            index = 0
            for i in range(bits):
                key = ("top", last, i, index) if i < 5 else ("rest", i, index)
                coded = (2 * index + 1) << (bits - 1 - i) < self.size
                index = 2 * index + (block.decision(key, 160) if coded else 0)
            last = index >> max(bits - 5, 0)
            indices.append(index)
        return self.log_scales[indices] + log_factors, self.rotations[indices]
