"""Damaged streams are exceptions, whatever the damage."""

from __future__ import annotations

import io
import random

from conftest import equal

import gsvx


def damaged(stream: bytes, rng: random.Random) -> bytes:
    data = bytearray(stream)
    kind = rng.randrange(5)
    if kind == 0:
        return bytes(data[: rng.randrange(len(data))])
    if kind == 1:
        start = rng.randrange(len(data))
        del data[start : start + rng.randrange(1, 50)]
    elif kind == 2:
        at = rng.randrange(len(data))
        data[at:at] = rng.randbytes(rng.randrange(1, 50))
    else:
        # Half of them in the head, where a mistake does most.
        end = len(data) if kind == 3 else 300
        for _ in range(rng.randrange(1, 8)):
            data[rng.randrange(end)] = rng.randrange(256)
    return bytes(data)


def test_a_thousand_corruptions_are_exceptions(small):
    rng = random.Random(1)
    streams = [
        gsvx.compress_to_bytes(small, **options)
        for options in ({}, dict(lossless=True), dict(web=True))
    ]
    whole = [gsvx.decompress_bytes(stream) for stream in streams]
    refused = 0
    for i in range(1000):
        data = damaged(streams[i % len(streams)], rng)
        try:
            # The damage may be in a part that is not decoded, such as a coarser level.
            assert equal(gsvx.decompress_bytes(data), whole[i % len(streams)])
        except gsvx.Error as error:
            refused += 1
            assert str(error)
        try:
            with gsvx.open(io.BytesIO(data)) as stream:
                for chunk in stream.chunks:
                    stream.read(chunk.number)
        except gsvx.Error:
            pass
    assert refused > 900
