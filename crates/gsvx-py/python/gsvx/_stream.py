"""Streams that are read in parts."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, BinaryIO, Dict, Iterator, List, Optional, Tuple

from . import _gsvx
from ._arrays import Splats, check_numbers, from_native
from ._files import Source, opened


@dataclass(frozen=True)
class Chunk:
    """A part of a stream that is decoded alone.

    ``number``: its place in the index. ``exact``: whether its Gaussians are coded bit for bit. ``lod``: level
    of detail, 0 is the finest. ``gaussians``: how many it has. ``bounds``: least and greatest coordinates of
    the means. ``offset``: its first byte. ``layers``: bytes of each layer; the first makes a picture, each
    further one adds an SH degree. ``finer``: numbers of the chunks of the next finer level that replace it.
    """

    number: int
    exact: bool
    lod: int
    gaussians: int
    bounds: "tuple[tuple[float, float, float], tuple[float, float, float]]"
    offset: int
    layers: List[int] = field(repr=False)
    finer: List[int] = field(repr=False)


class Stream:
    """A stream whose chunks are read one by one; :func:`gsvx.open` makes it.

    ``gaussians``: of the finest level. ``sh_degree``. ``antialiased``: see :func:`gsvx.compress`. ``lods``: levels of detail. ``octree_depth``,
    ``cube_origin``, ``cube_side``: the octree. ``size``: its bytes. ``parts``: bytes by part.
    ``chunks``: the index. ``bytes_read``: bytes read so far.
    """

    gaussians: int
    sh_degree: int
    antialiased: bool
    lods: int
    octree_depth: int
    cube_origin: Tuple[float, float, float]
    cube_side: float
    size: int
    parts: Dict[str, int]
    chunks: List[Chunk]
    bytes_read: int

    def __init__(self, source: Source, max_gaussians: Optional[int] = None) -> None:
        check_numbers({"max_gaussians": max_gaussians}, {})
        self._close = ExitStack()
        self._file: BinaryIO
        self.bytes_read = 0
        try:
            self._file, name = self._close.enter_context(opened(source))
            self._reader = _gsvx.Reader(name, max_gaussians)
            self._read_head(name)
        except BaseException:
            self._close.close()
            raise
        head: Dict[str, Any] = self._reader.head() or {}
        self.gaussians = head["gaussians"]
        self.sh_degree = head["sh_degree"]
        self.antialiased = head["antialiased"]
        self.lods = head["lods"]
        self.octree_depth = head["octree_depth"]
        self.cube_origin = tuple(head["cube_origin"])
        self.cube_side = head["cube_side"]
        self.size = head["bytes"]
        self.parts = head["parts"]
        for chunk in head["chunks"]:
            chunk["bounds"] = tuple(map(tuple, chunk["bounds"]))
        self.chunks = [Chunk(**chunk) for chunk in head["chunks"]]

    def _read_head(self, name: str) -> None:
        start = b""
        while (needs := self._reader.head_needs()) is not None:
            data = self._fetch(*needs)
            if not data:
                # The decoder of whole streams says what is missing.
                whole = dict(max_sh_degree=3, lod=0, salvage=False, max_gaussians=None)
                _gsvx.decompress(start, name, whole)
                raise _gsvx.Error(f"{name}: the head is not whole")
            start += data
            self._reader.give(needs[0], data)

    def _fetch(self, start: int, end: int) -> bytes:
        """The bytes of a range, fewer at the end of the file."""
        self._file.seek(start)
        parts = []
        while start < end:
            data = self._file.read(end - start)
            if not data:
                break
            parts.append(data)
            start += len(data)
        data = b"".join(parts)
        self.bytes_read += len(data)
        return data

    def read(self, chunk: int, *, max_sh_degree: Optional[int] = None) -> Splats:
        """Reads and decodes a chunk: only its bytes, and of those only the layers up to an SH degree.

        Returns a dict of arrays as :func:`gsvx.decompress` does. Raises IndexError for a number that is not
        in the index, :class:`gsvx.Error` for a damaged chunk.
        """
        entry = self.chunks[chunk]
        degree = 3 if max_sh_degree is None else max_sh_degree
        if not 0 <= degree <= 3:
            raise ValueError(f"max_sh_degree is {degree}, must be 0 to 3")
        layers = min(1 + degree, len(entry.layers))
        for start, end in self._reader.needs(entry.number, layers):
            self._reader.give(start, self._fetch(start, end))
        try:
            splats = from_native(self._reader.decode(entry.number, layers))
        finally:
            self._reader.forget(entry.number)
        k = (degree + 1) ** 2 - 1
        splats["shN"] = splats["shN"][:, :k]
        return splats

    def of_lod(self, lod: int = 0) -> List[Chunk]:
        """The chunks of a level of detail. Those that are coded bit for bit belong to every level."""
        return [chunk for chunk in self.chunks if chunk.exact or chunk.lod == lod]

    def each(
        self, lod: int = 0, *, max_sh_degree: Optional[int] = None
    ) -> Iterator[Tuple[Chunk, Splats]]:
        """The chunks of a level of detail with their Gaussians, one by one."""
        for chunk in self.of_lod(lod):
            yield chunk, self.read(chunk.number, max_sh_degree=max_sh_degree)

    def close(self) -> None:
        """Closes the file, if :func:`gsvx.open` opened it."""
        self._close.close()

    def __enter__(self) -> "Stream":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return (
            f"Stream({self.gaussians} Gaussians, SH degree {self.sh_degree}, {len(self.chunks)} chunks, "
            f"{self.size} bytes)"
        )


def open(source: Source, *, max_gaussians: Optional[int] = None) -> Stream:  # noqa: A001
    """Opens a stream and reads its head and index, no more.

    ``source``: a file name, or an object with ``read`` and ``seek``, such as a file that fsspec has opened:
    only the byte ranges that are needed are read. ``max_gaussians``: refuse chunks of more; the default follows from
    the chunk's length. ::

        with gsvx.open("scene.gsvx") as stream:
            for chunk, splats in stream.each():
                ...

    Raises :class:`gsvx.Error` for what is no stream, OSError for a file that cannot be read.
    """
    return Stream(source, max_gaussians)
