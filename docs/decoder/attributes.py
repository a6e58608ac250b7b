"""From transformed values to opacity, colour and covariance: format.md, sections 8, 9 and 11."""
import numpy as np

from entropy import Block, Bytes, SymbolModels, decision_models, need

F = np.float32

def f32_of_bits(*patterns):
    values = np.array(patterns, np.uint32).view(F)
    return values if len(values) > 1 else values[0]

A, B, G = f32_of_bits(0x3F13CD3B, 0x3F3504F3, 0x3ED105EC)

def offset(depths, factor_d, classes=0, factor_c=0):
    """What is added to V_0 for the depth and the importance class of each leaf."""
    return F(factor_d * depths + factor_c * classes) / F(64)

def importance_classes(v, depths, factor):
    return np.floor(np.clip(v[:, 0] + offset(depths, factor) + F(0.5), 0, 11)).astype(np.int64)

def opacity_logits(v):
    a = np.clip(v, F(-80), F(0))
    r = -expm1(a)
    seen = r >= F(2.0**-126)
    return np.where(seen, np.clip(a - log(np.where(seen, r, F(1))), F(-8), F(12)), F(12))

def colours(v):
    """Red, green, blue of Y, Co, Cg, along the last axis (8.3)."""
    y, o, g = v[..., 0] * A, v[..., 1] * B, v[..., 2] * G
    return np.stack([y + o - g, y + g + g, y - o - g], -1)

def covariances(c):
    """Log-scales and rotations of six coordinates per leaf (8.4, mode 0)."""
    c = np.clip(c, F(-1e6), F(1e6)).T
    t, u, e = c[0] * A, c[1] * B, c[2] * G
    M = {(0, 0): t + u - e, (1, 1): t - u - e, (2, 2): t + e + e,
         (0, 1): c[3] * B, (0, 2): c[4] * B, (1, 2): c[5] * B}
    V = np.zeros((3, 3, c.shape[1]), F)
    V[0, 0] = V[1, 1] = V[2, 2] = 1
    limit = F(1e-12) * sum_of_squares(c)
    for _ in range(8):
        sweep = sum_of_squares([M[0, 1], M[0, 2], M[1, 2]]) > limit
        for p, q in ((0, 1), (0, 2), (1, 2)):
            rotate(M, V, p, q, sweep & (M[p, q] != 0))
    return np.stack([M[0, 0], M[1, 1], M[2, 2]], 1), quaternions(V)

def sum_of_squares(values):
    total = values[0] * values[0]
    for value in values[1:]:
        total = total + value * value
    return total

def rotate(M, V, p, q, mask):
    """One Jacobi rotation in the plane (p, q), of the leaves in `mask`."""
    r = 3 - p - q
    rp, rq = tuple(sorted((r, p))), tuple(sorted((r, q)))
    theta = (M[q, q] - M[p, p]) / (F(2) * M[p, q])
    root = abs(theta) + np.sqrt(theta * theta + F(1))
    x = np.where(theta >= 0, F(1) / root, F(-1) / root)
    k = F(1) / np.sqrt(x * x + F(1))
    s = x * k
    new = {(p, p): M[p, p] - x * M[p, q], (q, q): M[q, q] + x * M[p, q], (p, q): F(0),
           rp: k * M[rp] - s * M[rq], rq: s * M[rp] + k * M[rq]}
    for place, value in new.items():
        M[place] = np.where(mask, value, M[place])
    columns = k * V[:, p] - s * V[:, q], s * V[:, p] + k * V[:, q]
    V[:, p], V[:, q] = (np.where(mask, new, V[:, i]) for new, i in zip(columns, (p, q)))

def quaternions(V):
    one = F(1)
    candidates = np.stack([one + V[0, 0] + V[1, 1] + V[2, 2], one + V[0, 0] - V[1, 1] - V[2, 2],
                           one - V[0, 0] + V[1, 1] - V[2, 2], one - V[0, 0] - V[1, 1] + V[2, 2]])
    m = np.maximum(candidates.max(0), one)
    wx, wy, wz = V[2, 1] - V[1, 2], V[0, 2] - V[2, 0], V[1, 0] - V[0, 1]
    xy, xz, yz = V[1, 0] + V[0, 1], V[0, 2] + V[2, 0], V[2, 1] + V[1, 2]
    table = np.array([[m, wx, wy, wz], [wx, m, xy, xz], [wy, xy, m, yz], [wz, xz, yz, m]])
    best = candidates.argmax(0)
    wxyz = table[best, :, np.arange(len(best))]
    length = np.sqrt(sum_of_squares(wxyz.T))
    return wxyz / np.where(wxyz[:, 0] < 0, -length, length)[:, None]

class Codebook:
    """8.5. `rotations` and `log_scales` have a row for each codeword."""

    def __init__(self, data):
        data = Bytes(data)
        r, s, self.size = data.number("B"), data.number("B"), data.varint()
        need(4 <= r <= 14 and 2 <= s <= 10 and 1 <= self.size <= 65536, "a codebook has bad numbers")
        words = self.words(Block(data.rest()))
        need(abs(words[:, :3]).max() <= 2 ** (r - 1) - 1, "a rotation of the codebook is out of range")
        need(words[:, 3:].min() >= 0 and words[:, 3:].max() <= 16 * 2**s, "a log-scale of the codebook is out of range")
        x, y, z = words[:, :3].T * (0.198912367379658 / (2 ** (r - 1) - 1))
        n = x * x + y * y + z * z
        i = 1 / (1 + n)
        self.rotations = F(np.stack([(1 - n) * i, x * (2 * i), y * (2 * i), z * (2 * i)], 1))
        self.log_scales = F(0 - words[:, 3:] / 2**s)

    def words(self, block):
        models = SymbolModels(lambda key: (256, 2))
        words, last_class, word = [], [0] * 6, [0] * 6
        for _ in range(self.size):
            for k in range(6):
                b = block.symbol(models[k, last_class[k]])
                last_class[k] = (b > 0) + (b > 2) + (b > 5)
                if b > 0:
                    magnitude = 2 ** (b - 1) + block.bits(b - 1)
                    word[k] += -magnitude if block.bits(1) else magnitude
            words.append(list(word))
        block.end()
        return np.array(words)

    def indices(self, block, count):
        bits = (self.size - 1).bit_length()
        top, rest, last, indices = decision_models(), decision_models(), 0, []
        for _ in range(count):
            index = 0
            for i in range(bits):
                node, bit = 2**i + index, 0
                if (2 * index + 1) << (bits - 1 - i) < self.size:
                    bit = block.decision(top[last, node] if i < 5 else rest[node], 160)
                index = 2 * index + bit
            last = index >> max(bits - 5, 0)
            indices.append(index)
        return indices

def expm1(x):
    """expm1f of MSUN for -80 <= x <= 0 (section 11)."""
    H, P, I, Q1, Q2 = f32_of_bits(0x3F317180, 0x3717F7D1, 0x3FB8AA3B, 0xBD088868, 0x3ACF3010)
    size, given = abs(x).view(np.uint32), x
    k = np.where(size < 0x3F851592, F(-1), np.trunc(I * x - F(0.5)))
    k = np.where(size <= 0x3EB17218, F(0), k)
    hi, lo = x - k * H, k * P
    x = hi - lo
    c = (hi - x) - lo
    half = F(0.5) * x
    square = x * half
    r = F(1) + square * (Q1 + square * Q2)
    t = F(3) - r * half
    e = square * ((r - t) / (F(6) - x * t))
    near = x - (x * e - square)
    e = x * (e - c) - c
    e = e - square
    result = np.where(k == -1, F(0.5) * (x - e) - F(0.5), np.ldexp(x - e + F(1), k.astype(np.int32)) - F(1))
    result = np.where(k == 0, near, result)
    result = np.where(size < 0x33000000, given, result)
    return np.where(size >= 0x4195B844, F(-1), result)

def log(x):
    """logf of MSUN for 2^-126 <= x <= 1 (section 11)."""
    H, P, L1, L2, L3, L4, least = f32_of_bits(
        0x3F317180, 0x3717F7D1, 0x3F2AAAAA, 0x3ECCCE13, 0x3E91E9EE, 0x3E789E26, 0x3F3504F3)
    f, k = np.frexp(x)
    low = f < least
    f, k = np.where(low, F(2) * f, f), F(k - low)
    f = f - F(1)
    s = f / (F(2) + f)
    z = s * s
    w = z * z
    r = z * (L1 + w * L3) + w * (L2 + w * L4)
    half = F(0.5) * f * f
    result = s * (half + r) + k * P - half + f + k * H
    return np.where(x == 1, F(0), result)

def sh_degree(data, k, leaf_count, raht_of, step, below):
    """Final values (leaves, 2k + 1 coefficients, Y Co Cg) of an SH layer that is not empty (section 9)."""
    data, run_bits = Bytes(data), 0
    if k >= 2:
        run_bits = data.number("B")
        need(run_bits == 0 or 10 <= run_bits <= 30, "a run length is out of range")
    if run_bits:
        runs = -(-leaf_count // 2**run_bits)
        factors = np.array(data.numbers("%db" % (runs * (2 * k + 1) * (2 * k - 1))))
        factors = F(factors.reshape(runs, 2 * k + 1, 2 * k - 1)) / F(64)
    block = Block(data.rest())
    values = raht_of(block).attribute(3 * (2 * k + 1), step).reshape(leaf_count, 2 * k + 1, 3)
    block.end()
    if run_bits:
        factors = factors[np.arange(leaf_count) >> run_bits]
        s = F(0)
        for j in range(2 * k - 1):
            s = s + factors[:, :, j, None] * below[:, None, j]
        values = values + s
    return values
