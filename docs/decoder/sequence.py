"""Sequences of frames: format-sequences.md."""
from types import SimpleNamespace

import numpy as np

from entropy import Block, Bytes, need
from gsvx_decoder import EXACT, Head, Scene, chunk_values, decode, layer_bytes, opened, scene_of
from transform import F, Merges, Raht

CHANNELS = 3, 1, 3, 6, 9, 15, 21

def groups(stream):
    """For each group the number of its frames, its static stream and what moves (1)."""
    fields, at = opened(stream, 2)
    rate = fields.number("f")
    need(np.isfinite(rate) and rate > 0, "a wrong number of frames per second")
    for _ in range(fields.varint()):
        frames, static, motion, crc = fields.varint(), fields.varint(), fields.varint(), fields.number("I")
        need(1 <= frames <= 256, "a wrong number of frames")
        both = layer_bytes(stream, at, static + motion, crc)
        at += static + motion
        yield frames, both[:static], both[static:]

def curves(fields, channels, frames):
    step, number = F(fields.number("f")) * F(32), fields.number("B") + 1
    need(number <= frames, "too many curves")
    all_curves = []
    for _ in range(number):
        values = F(fields.numbers(f"{frames}h")) / F(2048)
        factors = F(fields.numbers(f"{channels**2}f")).reshape(channels, channels) if fields.number("B") else None
        all_curves.append((values, factors))
    return step, all_curves

def flags(block, name, count):
    found = []
    for _ in range(count):
        before = [0, 0] + found
        found.append(block.decision((name, before[-1] + 2 * before[-2]), 255))
    return found

def births(block, count, frames):
    alive = np.ones((count, frames), bool)
    for leaf in alive:
        if not block.decision(("birth", 0), 255):
            state = 1
            for t in range(frames):
                leaf[t] = block.decision(("birth", state), 255)
                state = 2 + leaf[t]
    return alive

def motion(data, values, frames):
    """What moves in a chunk (2), and who is there: leaves, curves and coefficients by attribute."""
    count = len(values.codes)
    moving, alive = [], np.ones((count, frames), bool)
    if not data:
        return moving, alive
    fields = Bytes(data)
    bits = fields.number("B")
    need((bits & 127) >> len(values.attributes) == 0, "an attribute moves that is not there")
    heads = [(a, *curves(fields, CHANNELS[a], frames)) for a in range(len(values.attributes)) if bits >> a & 1]
    block = Block(fields.read())
    if bits & 128:
        alive = births(block, count, frames)
    for a, step, all_curves in heads:
        block.start_models()
        leaves = np.flatnonzero(flags(block, "moves", count))
        raht = Raht(block, Merges([values.codes[i] for i in leaves]), values.weights[leaves])
        coefficients = []
        for _, factors in all_curves:
            b, s = raht.attribute(CHANNELS[a], step), F(0)
            if factors is not None:
                for i in range(CHANNELS[a]):
                    s = s + factors[None, :, i] * values.attributes[a][leaves, i, None]
                b = b + s
            coefficients.append(b)
        moving.append((a, leaves, all_curves, coefficients))
    block.end()
    return moving, alive

def frame(values, moving, alive, t):
    """The Gaussians of a chunk in frame `t` (3)."""
    attributes = [v.copy() for v in values.attributes]
    for a, leaves, all_curves, coefficients in moving:
        for (curve, _), b in zip(all_curves, coefficients):
            attributes[a][leaves] = attributes[a][leaves] + curve[t] * b
    scene = scene_of(SimpleNamespace(attributes=attributes))
    return Scene(*(v[alive[:, t]] for v in scene))

@np.errstate(all="ignore")
def decode_frames(stream):
    """The scenes of all frames."""
    scenes = []
    for frames, static, moves in groups(stream):
        head, blocks, chunks, rest = Head(static), Bytes(moves), [], []
        for number, chunk in enumerate(head.chunks):
            if chunk.kind == EXACT:
                rest.append(chunk)
            elif chunk.kind == 0:
                values = chunk_values(head, number, [layer_bytes(static, *layer) for layer in chunk.layers])
                chunks.append((values, *motion(blocks.sized() if moves else b"", values, frames)))
        last = decode(static)
        exact = Scene(*(v[len(v) - sum(c.count for c in rest):] for v in last))
        for t in range(frames):
            parts = [frame(*chunk, t) for chunk in chunks]
            scenes.append(Scene(*map(np.concatenate, zip(*parts, exact))))
    return scenes
