"""Decodes gsvx streams, format 1: a second decoder, written from docs/format.md alone.

    python3 gsvx_decoder.py STREAM      prints what the stream holds

`decode` follows sections 2, 3 and 10; the other files follow one section each.
"""
import sys
from typing import NamedTuple

import numpy as np

from attributes import (F, Codebook, colours, covariances, importance_classes, offset,
                        opacity_logits, sh_degree)
from entropy import Block, Bytes, crc32c, need
from geometry import Geometry, axes
from lossless import exact_columns, integer_covariances
from transform import Merges, Raht

SIGNATURE = bytes.fromhex("89475356580d0a1a")
EXACT = 255

class Scene(NamedTuple):
    """Arrays of f32, with one row for each Gaussian."""
    means: np.ndarray           # x y z
    opacity_logits: np.ndarray
    log_scales: np.ndarray      # 3
    rotations: np.ndarray       # w x y z
    sh: np.ndarray              # (D + 1)^2 coefficients of red, green, blue

class Chunk:
    """An entry of the index."""

    def __init__(self, fields, head, at):
        self.kind, self.count, self.first_cell = fields.number("B"), fields.varint(), fields.varint()
        need(self.kind <= 8 or self.kind == EXACT, "an unknown kind of chunk")
        need(1 <= self.count <= 2**32 - 2, "a chunk has a bad number of Gaussians")
        need(self.first_cell < (1 if self.kind == EXACT else 8**head.depth), "a first cell is out of range")
        self.bounds = fields.numbers("6f")
        self.layers = []
        for _ in range(1 if self.kind == EXACT else 1 + head.degree):
            length = fields.varint()
            self.layers.append((at, length, fields.number("I")))
            at += length
        self.end = at

class Head:
    """Section 2."""

    def __init__(self, stream):
        start = Bytes(stream)
        need(start.take(8) == SIGNATURE, "not a gsvx stream")
        need(start.number("B") == 1, "another version of the format")
        fields = Bytes(start.take(start.number("I")))
        covered = start.at
        need(start.number("I") == crc32c(stream[:covered]), "the head is damaged")
        self.degree, self.depth, self.mode = fields.numbers("3B")
        need(self.degree <= 3 and self.depth <= 21 and self.mode <= 2, "the header is not valid")
        self.origin, self.side = fields.numbers("3d"), fields.number("d")
        need(np.isfinite(self.origin).all() and 0 < self.side < np.inf, "the cube is not valid")
        steps = fields.numbers("6f")
        need(all(2.0**-126 <= step < 1e9 for step in steps), "a step is not valid")
        self.step_opacity, self.step_dc, *self.steps_sh, self.step_covariance = F(steps) * F(32)
        self.count = fields.varint()
        self.codebook = Codebook(fields.sized()) if self.mode == 2 else None
        self.chunks, at = [], start.at
        for _ in range(fields.varint()):
            self.chunks.append(Chunk(fields, self, at))
            at = self.chunks[-1].end
        order = [(chunk.kind == EXACT, -chunk.kind, chunk.first_cell) for chunk in self.chunks]
        need(all(a < b or a[0] and b[0] for a, b in zip(order, order[1:])), "the chunks are not in order")
        need(self.count == sum(c.count for c in self.chunks if c.kind in (0, EXACT)), "a wrong number of Gaussians")

class LeafChunk:
    """Decodes a chunk of leaves: the base layer, then degree by degree (sections 3, 5, 8, 9)."""

    def __init__(self, head, chunk, base, end_cell):
        self.head = head
        base = Bytes(base)
        mixed = base.number("B")
        need(mixed <= 1, "depths are neither equal nor mixed")
        self.factors = base.numbers("5b")
        integers = base.sized() if head.mode == 1 else None
        block = Block(base.rest())
        leaves = Geometry(block, head.depth, mixed).leaves(chunk.count)
        codes = [code for code, _ in leaves]
        last, last_depth = leaves[-1]
        need(codes[0] == chunk.first_cell, "a chunk does not begin at its first cell")
        need(last + 8 ** (head.depth - last_depth) <= end_cell, "a chunk reaches into the next one")
        self.depths = np.array([depth for _, depth in leaves])
        self.indices = np.stack(axes(np.array(codes), head.depth), 1) if head.depth else np.zeros((1, 3), np.int64)
        self.merges = Merges(codes)
        self.sh = [self.base_attributes(block, integers)]

    def means(self):
        half = 0.5 * 2.0 ** (self.head.depth - self.depths)
        means = F(self.head.origin + (self.indices + half[:, None]) * (self.head.side / 2**self.head.depth))
        need(np.isfinite(means).all(), "a mean is not finite")
        return means

    def raht(self, block):
        return Raht(block, self.merges, self.weights)

    def base_attributes(self, block, integers):
        """Sets opacity and covariance; the result is Y, Co, Cg of degree 0."""
        head, depths, count = self.head, self.depths, len(self.depths)
        a_importance, a_opacity, b_opacity, a_covariance, b_covariance = self.factors
        classes = importance_classes(Raht(block, self.merges, [1] * count).attribute(1, 1), depths, a_importance)
        self.weights = 4**classes
        need(self.weights.sum() < 2**50, "the weights of a chunk are too large")
        raht = self.raht(block)
        opacity = raht.attribute(1, head.step_opacity)[:, 0]
        self.opacity_logits = opacity_logits(opacity + offset(depths, a_opacity, classes, b_opacity))
        dc = raht.attribute(3, head.step_dc)
        if head.mode == 1:
            sizes = 2 ** (head.depth - depths)
            self.log_scales, self.rotations = integer_covariances(integers, 2 * self.indices + sizes[:, None])
        else:
            v = raht.attribute(6 if head.mode == 0 else 1, head.step_covariance)
            v[:, 0] += offset(depths, a_covariance, classes, b_covariance)
            if head.mode == 0:
                self.log_scales, self.rotations = covariances(v)
            else:
                chosen = head.codebook.indices(block, count)
                self.log_scales = head.codebook.log_scales[chosen] + v
                self.rotations = head.codebook.rotations[chosen]
        block.end()
        return dc.reshape(-1, 1, 3)

    def add_degree(self, layer):
        k = len(self.sh)
        if layer:
            step = self.head.steps_sh[k - 1]
            self.sh.append(sh_degree(layer, k, len(self.depths), self.raht, step, self.sh[-1]))
        else:
            self.sh.append(np.zeros((len(self.depths), 2 * k + 1, 3), F))

    def scene(self):
        return Scene(self.means(), self.opacity_logits, self.log_scales, self.rotations,
                     np.concatenate([colours(values) for values in self.sh], 1))

def layer_bytes(stream, layer):
    at, length, crc = layer
    need(at + length <= len(stream), "a layer goes beyond the end of the stream")
    data = stream[at:at + length]
    need(crc32c(data) == crc, "a layer is damaged")
    return data

def decode_chunk(stream, head, number, degree):
    chunk = head.chunks[number]
    layers = (layer_bytes(stream, layer) for layer in chunk.layers[:1 + degree])
    if chunk.kind == EXACT:
        c = exact_columns(next(layers), chunk.count, head.degree)
        sh = c[:, 11:].reshape(len(c), -1, 3).copy()
        sh[:, (degree + 1) ** 2:] = 0
        return Scene(c[:, :3], c[:, 3], c[:, 4:7], c[:, 7:11], sh)
    following = head.chunks[number + 1:number + 2]
    same_level = following and following[0].kind == chunk.kind
    leaves = LeafChunk(head, chunk, next(layers), following[0].first_cell if same_level else 8**head.depth)
    for k in range(1, head.degree + 1):
        leaves.add_degree(next(layers) if k <= degree else b"")
    return leaves.scene()

def decode(stream, level=0, degree=3):
    """The scene at a level of detail (0 is the finest), with SH up to a degree."""
    head = Head(stream)
    chosen = [i for i, chunk in enumerate(head.chunks) if chunk.kind in (level, EXACT)]
    need(sum(head.chunks[i].count for i in chosen) <= 1024 * len(stream) + 2**17, "too many Gaussians")
    with np.errstate(all="ignore"):
        parts = [decode_chunk(stream, head, i, degree) for i in chosen]
    shapes = ((0, 3), (0,), (0, 3), (0, 4), (0, (head.degree + 1) ** 2, 3))
    empty = Scene(*(np.zeros(shape, F) for shape in shapes))
    return Scene(*(np.concatenate(arrays) for arrays in zip(empty, *parts)))

if __name__ == "__main__":
    with open(sys.argv[1], "rb") as file:
        for name, values in decode(file.read())._asdict().items():
            print(name, values.shape)
            print(values[:3])
