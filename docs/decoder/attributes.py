"""From transformed values to opacity, colour and covariance: format.md, sections 8, 9 and 11."""
import numpy as np

from entropy import Block, Bytes
from transform import F, Raht

def f32s(*bit_patterns):
    return np.array(bit_patterns, np.uint32).view(F)

A, B, G = f32s(0x3F13CD3A, 0x3F3504F3, 0x3ED105EC)
H, P = f32s(0x3F317180, 0x3717F7D1)

def offset(depths, factor_d, classes=0, factor_c=0):
    """What is added to V_0 for the depth and the importance class of each leaf."""
    return F(factor_d * depths + factor_c * classes) / F(64)

def opacity_logits(v):
    a = np.clip(v, F(-80), F(0))
    r = -expm1(a)
    return np.where(r >= F(2.0**-126), np.clip(a - log(r), F(-8), F(12)), F(12))

def colours(v):
    """Red, green, blue of Y, Co, Cg, along the last axis (8.3)."""
    y, o, g = v[..., 0] * A, v[..., 1] * B, v[..., 2] * G
    return np.stack([y + o - g, y + g + g, y - o - g], -1)

def sum_of_squares(values):
    return sum(value * value for value in values)  # from left to right

def covariances(coordinates):
    """Log-scales and rotations of mode 0 (8.4)."""
    c = np.clip(coordinates, F(-1e6), F(1e6)).T
    t, u, e = c[0] * A, c[1] * B, c[2] * G
    M = {(0, 0): t + u - e, (1, 1): t - u - e, (2, 2): t + e + e,
         (0, 1): c[3] * B, (0, 2): c[4] * B, (1, 2): c[5] * B}
    V = np.zeros((3, 3, c.shape[1]), F) + np.eye(3, dtype=F)[:, :, None]
    limit = F(1e-12) * sum_of_squares(c)
    for _ in range(8):
        sweep = sum_of_squares([M[0, 1], M[0, 2], M[1, 2]]) > limit
        for p, q in ((0, 1), (0, 2), (1, 2)):
            rotate(M, V, p, q, sweep & (M[p, q] != 0))
    return np.stack([M[0, 0], M[1, 1], M[2, 2]], 1), quaternions(V)

def rotate(M, V, p, q, mask):
    """One Jacobi rotation in the plane (p, q), of the leaves in `mask`. M has only its upper half."""
    theta = (M[q, q] - M[p, p]) / (F(2) * M[p, q])
    root = abs(theta) + np.sqrt(theta * theta + F(1))
    x = np.where(theta >= 0, F(1) / root, F(-1) / root)
    k = F(1) / np.sqrt(x * x + F(1))
    s, r = x * k, 3 - p - q
    rp, rq = (min(r, p), max(r, p)), (min(r, q), max(r, q))
    new = {(p, p): M[p, p] - x * M[p, q], (q, q): M[q, q] + x * M[p, q], (p, q): F(0),
           rp: k * M[rp] - s * M[rq], rq: s * M[rp] + k * M[rq]}
    M.update({place: np.where(mask, value, M[place]) for place, value in new.items()})
    turned = k * V[:, p] - s * V[:, q], s * V[:, p] + k * V[:, q]
    V[:, p], V[:, q] = np.where(mask, turned[0], V[:, p]), np.where(mask, turned[1], V[:, q])

def quaternions(V):
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = V
    one = F(1)
    candidates = np.array([one + xx + yy + zz, one + xx - yy - zz, one - xx + yy - zz, one - xx - yy + zz])
    m = np.maximum(candidates.max(0), one)
    table = np.array([[m, zy - yz, xz - zx, yx - xy], [zy - yz, m, yx + xy, xz + zx],
                      [xz - zx, yx + xy, m, zy + yz], [yx - xy, xz + zx, zy + yz, m]])
    wxyz = table[candidates.argmax(0), :, np.arange(len(m))]
    length = np.sqrt(sum_of_squares(wxyz.T))
    return wxyz / np.where(wxyz[:, 0] < 0, -length, length)[:, None]

def sh_degree(k, layer, merges, weights, step, below):
    """Final values (leaves, 2k + 1 coefficients, Y Co Cg) of an SH layer that is not empty (9)."""
    layer, n, s = Bytes(layer), merges.count, F(0)
    run_bits = layer.number("B") if k >= 2 else 0
    if run_bits > 0:
        runs = np.arange(n) >> run_bits
        shape = runs[-1] + 1, 2 * k + 1, 2 * k - 1
        factors = F(np.reshape(layer.numbers("%db" % np.prod(shape)), shape)) / F(64)
        for j in range(2 * k - 1):
            s = s + factors[runs, :, j, None] * below[:, None, j]
    block = Block(layer.read())
    values = Raht(block, merges, weights).attribute(3 * (2 * k + 1), step).reshape(n, 2 * k + 1, 3)
    block.end()
    return values + s if run_bits > 0 else values

def expm1(x):
    """expm1f of MSUN for -80 <= x <= 0 (11)."""
    I, Q1, Q2 = f32s(0x3FB8AA3B, 0xBD088868, 0x3ACF3010)
    size, given = abs(x).view(np.uint32), x
    k = np.select([size <= 0x3EB17218, size < 0x3F851592], [F(0), F(-1)], np.trunc(I * x - F(0.5)))
    hi, lo = x - k * H, k * P
    x = hi - lo
    c = (hi - x) - lo
    half = F(0.5) * x
    square = x * half
    r = F(1) + square * (Q1 + square * Q2)
    t = F(3) - r * half
    e = square * ((r - t) / (F(6) - x * t))
    near = x - (x * e - square)
    e = x * (e - c) - c - square
    return np.select([size >= 0x4195B844, size < 0x33000000, k == 0, k == -1],
                     [F(-1), given, near, F(0.5) * (x - e) - F(0.5)],
                     np.ldexp(x - e + F(1), k.astype(np.int32)) - F(1))

def log(x):
    """logf of MSUN for 2^-126 <= x <= 1 (11)."""
    least, L1, L2, L3, L4 = f32s(0x3F3504F3, 0x3F2AAAAA, 0x3ECCCE13, 0x3E91E9EE, 0x3E789E26)
    f, k = np.frexp(x)
    low = f < least
    f, k = np.where(low, F(2) * f, f) - F(1), F(k - low)
    s = f / (F(2) + f)
    z = s * s
    w = z * z
    r = z * (L1 + w * L3) + w * (L2 + w * L4)
    half = F(0.5) * f * f
    return np.where(x == 1, F(0), s * (half + r) + k * P - half + f + k * H)
