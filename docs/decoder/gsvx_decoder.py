"""A second decoder of gsvx streams, format 1: format.md, sections 2, 3 and 5. The other files have the rest.

    python3 gsvx_decoder.py STREAM      prints what the stream holds
"""
import sys
from collections import namedtuple

import numpy as np

from attributes import F, colours, covariances, offset, opacity_logits, sh_degree
from entropy import Block, Bytes, crc32c, need
from exact import exact_columns
from geometry import axes, leaves
from trace import note
from transform import Merges, Raht

EXACT = 255

# Arrays of f32 with a row for each Gaussian. Rotations are w x y z, `sh` is (D + 1)^2 times red, green, blue.
Scene = namedtuple("Scene", "means opacity_logits log_scales rotations sh")

ChunkValues = namedtuple("ChunkValues", "codes weights attributes")

# An entry of the index. A layer has a place in the stream, a length and a CRC-32C.
Chunk = namedtuple("Chunk", "kind count first_cell box layers")

def opened(stream, version):
    """The body of a head of this version, and the head's length."""
    start = Bytes(stream)
    need(start.take(9) == b"\x89GSVX\r\n\x1a" + bytes([version]), "not a gsvx stream of this version")
    body = start.number("I")
    need(body <= 2**26, "the head is too long")
    fields = Bytes(start.take(body))
    need(crc32c(stream[:start.tell()]) == start.number("I"), "the head is damaged")
    return fields, start.tell()

class Head:
    """Section 2."""

    def __init__(self, stream):
        fields, at = opened(stream, 1)
        first, self.depth, *cube = fields.numbers("2B4d")
        self.degree, self.antialiased = first & 0x3F, bool(first & 0x40)
        self.corner, self.side = np.array(cube[:3]), cube[3]
        self.step_opacity, self.step_dc, *self.steps_sh, self.step_covariance = F(fields.numbers("6f")) * F(32)
        self.origin = fields.numbers("3d") if first & 0x80 else (0.0, 0.0, 0.0)
        count = fields.varint()
        self.chunks = []
        for _ in range(fields.varint()):
            kind, number, first_cell = fields.number("B"), fields.varint(), fields.varint()
            self.chunks.append(Chunk(kind, number, first_cell, fields.numbers("6f"), []))
            for _ in range(1 if kind == EXACT else 1 + self.degree):
                length = fields.varint()
                self.chunks[-1].layers.append((at, length, fields.number("I")))
                at += length
        order = [(c.kind == EXACT, -c.kind, c.first_cell) for c in self.chunks]
        need(all(a < b or a[0] and b[0] for a, b in zip(order, order[1:])), "the chunks are not in order")
        need(count == sum(c.count for c in self.chunks if c.kind in (0, EXACT)), "a wrong number of Gaussians")

def chunk_values(head, number, layers):
    """The values of a chunk of leaves (5 and 8), with the SH layers that are given (9), before they become Gaussians:
    codes, weights, and of each attribute, the means first, a row per leaf."""
    base, J, chunk = Bytes(layers[0]), head.depth, head.chunks[number]
    a_importance, a_opacity, b_opacity, a_covariance, b_covariance = base.numbers("5b")
    block = Block(base.read())
    codes, depths = zip(*leaves(block, J, chunk.count))
    behind = [other.first_cell for other in head.chunks[number + 1:number + 2] if other.kind == chunk.kind]
    end = codes[-1] + 8 ** (J - depths[-1])
    need(codes[0] == chunk.first_cell and not any(end > cell for cell in behind), "a chunk leaves its cells")
    merges, depths = Merges(codes), np.array(depths)
    indices, sizes = np.stack(axes(np.array(codes), J), 1), 2 ** (J - depths)[:, None]
    means = F(head.corner + (indices + 0.5 * sizes) * (head.side / 2**J))

    v = Raht(block, merges, np.ones(chunk.count)).attribute(1, 1)[:, 0]
    classes = np.floor(np.clip(v + offset(depths, a_importance) + F(0.5), 0, 11)).astype(np.int64)
    for i, leaf in enumerate(zip(codes, depths, classes)):
        note("leaf %d: code %d, depth %d, class %d" % (i, *leaf))
    weights = 4**classes
    raht = Raht(block, merges, weights)
    opacity = raht.attribute(1, head.step_opacity) + offset(depths, a_opacity, classes, b_opacity)[:, None]
    degrees = [raht.attribute(3, head.step_dc).reshape(-1, 1, 3)]
    v = raht.attribute(6, head.step_covariance)
    v[:, 0] += offset(depths, a_covariance, classes, b_covariance)
    block.end()

    for k in range(1, head.degree + 1):
        if k < len(layers) and layers[k]:
            degrees.append(sh_degree(k, layers[k], merges, weights, head.steps_sh[k - 1], degrees[-1]))
        else:
            degrees.append(np.zeros((chunk.count, 2 * k + 1, 3), F))
    dc, *higher = (values.reshape(chunk.count, -1) for values in degrees)
    return ChunkValues(codes, weights, [means, opacity, dc, v, *higher])

def scene_of(values):
    """Gaussians of the values of a chunk."""
    means, opacity, dc, covariance, *higher = values.attributes
    log_scales, rotations = covariances(covariance)
    degrees = [colours(v.reshape(len(v), -1, 3)) for v in (dc, *higher)]
    return Scene(means, opacity_logits(opacity[:, 0]), log_scales, rotations, np.hstack(degrees))

def layer_bytes(stream, at, length, crc):
    data = stream[at:at + length]
    need(len(data) == length and crc32c(data) == crc, "a layer is damaged or missing")
    return data

def scene_of_columns(columns, degree):
    sh = columns[:, 11:].reshape(len(columns), (degree + 1) ** 2, 3)
    return Scene(columns[:, :3], columns[:, 3], columns[:, 4:7], columns[:, 7:11], sh)

@np.errstate(all="ignore")  # of values that are masked out
def decode(stream, level=0, degree=3):
    """The scene at a level of detail, 0 being the finest, with SH up to `degree` in chunks of leaves."""
    head = Head(stream)
    parts = [scene_of_columns(np.zeros((0, 11 + 3 * (head.degree + 1) ** 2), F), head.degree)]
    for number, chunk in enumerate(head.chunks):
        if chunk.kind not in (level, EXACT):
            continue
        layers = [layer_bytes(stream, *layer) for layer in chunk.layers[:1 + degree]]
        if chunk.kind == EXACT:
            parts.append(scene_of_columns(exact_columns(layers[0], chunk.count, head.degree), head.degree))
        else:
            parts.append(scene_of(chunk_values(head, number, layers)))
    return Scene(*map(np.concatenate, zip(*parts)))

if __name__ == "__main__":
    with open(sys.argv[1], "rb") as file:
        stream = file.read()
    head = Head(stream)
    print("SH degree %d, antialiased: %s, origin: %s" % (head.degree, head.antialiased, head.origin))
    for name, values in decode(stream)._asdict().items():
        print(name, values.shape, values[:3].tolist())
