"""open: streams in parts."""

from __future__ import annotations

import io

import numpy as np
import pytest
from conftest import equal

import gsvx


class Ranged(io.RawIOBase):
    """A file that notes what is read, as a server of ranges would."""

    def __init__(self, data):
        self.data, self.at, self.ranges = data, 0, []

    def seek(self, at, whence=0):
        self.at = at
        return at

    def read(self, size=-1):
        end = len(self.data) if size < 0 else min(self.at + min(size, 1000), len(self.data))
        data = self.data[self.at : end]
        self.ranges.append((self.at, end))
        self.at = end
        return data


@pytest.fixture()
def stream(splats) -> bytes:
    four = [{name: array.copy() for name, array in splats.items()} for _ in range(4)]
    for i, part in enumerate(four):
        part["means"] += np.float32([10 * i, 0, 0])
    all_of = {name: np.concatenate([part[name] for part in four]) for name in splats}
    return gsvx.compress_to_bytes(all_of, web=True)


def test_only_the_bytes_of_a_chunk_are_read(stream):
    file = Ranged(stream)
    with gsvx.open(file) as opened:
        assert opened.bytes_read < 5000 and opened.size == len(stream)
        assert opened.lods > 1 and len(opened.chunks) > 3
        chunk = opened.of_lod(0)[1]
        before = len(file.ranges)
        opened.read(chunk.number, max_sh_degree=0)
        end = chunk.offset + chunk.layers[0]
        assert all(chunk.offset <= a and b <= end for a, b in file.ranges[before:])
    assert not file.closed, "a file that was open stays open"


def test_chunks_one_after_another_are_the_whole(stream, tmp_path):
    whole = gsvx.decompress_bytes(stream)
    path = tmp_path / "s.gsvx"
    path.write_bytes(stream)
    with gsvx.open(path) as opened:
        numbers = [chunk.number for chunk in opened.of_lod()]
        assert sum(chunk.gaussians for chunk, _ in opened.each()) == len(whole["means"])
        low, high = opened.chunks[numbers[0]].bounds
        means = opened.read(numbers[0])["means"]
        assert (means.min(axis=0) == low).all() and (means.max(axis=0) == high).all()
        coarse = opened.of_lod(opened.lods - 1)
        finer = {number for chunk in coarse for number in chunk.finer}
        assert finer == {chunk.number for chunk in opened.of_lod(opened.lods - 2)}
        with pytest.raises(IndexError):
            opened.read(len(opened.chunks))
    assert equal(gsvx.decompress(path, chunks=numbers), whole)
    two = gsvx.decompress(path, chunks=numbers[1:], max_sh_degree=1)
    assert two["shN"].shape[1] == 3 and len(two["means"]) < len(whole["means"])
    assert len(gsvx.decompress(path, chunks=[])["means"]) == 0
    with pytest.raises(ValueError):
        gsvx.decompress(path, chunks=[0], lod=1)


def test_outliers_belong_to_every_level(splats):
    splats = {name: array.copy() for name, array in splats.items()}
    splats["means"][:2] = [[1e7, 0, 0], [0, -1e7, 0]]
    data = gsvx.compress_to_bytes(splats, lod=True, quality=30)
    with gsvx.open(io.BytesIO(data)) as stream:
        assert stream.chunks[-1].exact and stream.of_lod(1)[-1].exact
        assert stream.read(stream.chunks[-1].number, max_sh_degree=1)["shN"].shape == (2, 3, 3)


def test_what_is_no_stream_is_an_error(stream):
    for data, said in [
        (b"", "not a gsvx stream"),
        (b"plain text", "not a gsvx stream"),
        (stream[:5], "truncated"),
        (stream[:60], "truncated in head"),
    ]:
        with pytest.raises(gsvx.Error, match=said):
            gsvx.open(io.BytesIO(data))
    damaged = bytearray(stream)
    damaged[-5] ^= 1
    with gsvx.open(io.BytesIO(damaged)) as opened:
        with pytest.raises(gsvx.Error, match="is damaged"):
            opened.read(len(opened.chunks) - 1)
        assert len(opened.read(0)["means"]), "others can be read"
    with pytest.raises(ValueError, match="read and seek"):
        gsvx.open(7)


def test_a_chunk_of_more_gaussians_than_the_caller_accepts_is_refused(stream, tmp_path):
    with gsvx.open(io.BytesIO(stream), max_gaussians=10) as opened:
        with pytest.raises(gsvx.Error, match="more than the limit of 10"):
            opened.read(len(opened.chunks) - 1)
    with pytest.raises(ValueError, match="max_gaussians"):
        gsvx.open(io.BytesIO(stream), max_gaussians=-1)


def test_fsspec(stream, tmp_path):
    fsspec = pytest.importorskip("fsspec")
    filesystem = fsspec.filesystem("memory")
    filesystem.pipe("/s.gsvx", stream)
    whole = gsvx.decompress_bytes(stream)
    for file in (filesystem.open("/s.gsvx"), fsspec.open("memory://s.gsvx")):
        with gsvx.open(file) as opened:
            assert opened.gaussians == len(whole["means"])
            opened.read(0)
    assert equal(gsvx.decompress(filesystem.open("/s.gsvx")), whole)
