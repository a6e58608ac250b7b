"""Sequences of frames."""

from __future__ import annotations

from typing import Iterator, List, Optional, Tuple

from . import _gsvx
from ._arrays import Splats, check_numbers, from_native
from ._files import Source, opened


class Frames:
    """The frames of a sequence, decoded when they are asked for; :func:`gsvx.frames` makes it.

    ``len(frames)``, ``frames[17]``, ``for splats in frames``: a frame is a dict of arrays as :func:`gsvx.decompress`
    returns it. ``fps``: frames per second. ``groups``: first frame of each group, and the one behind its last; a group
    is decoded as a whole, and the last one is kept.
    """

    fps: float
    groups: List[Tuple[int, int]]

    def __init__(self, source: Source, max_gaussians: Optional[int] = None) -> None:
        check_numbers({"max_gaussians": max_gaussians}, {})
        with opened(source) as (file, name):
            file.seek(0)
            self._reader = _gsvx.FrameReader(file.read(), name, max_gaussians)
        self.fps = self._reader.fps
        self.groups = self._reader.groups

    def __len__(self) -> int:
        return self.groups[-1][1] if self.groups else 0

    def __getitem__(self, number: int) -> Splats:
        return from_native(self._reader.frame(number))

    def __iter__(self) -> Iterator[Splats]:
        return (self[number] for number in range(len(self)))

    def __repr__(self) -> str:
        return f"Frames({len(self)} in {len(self.groups)} groups, {self.fps:g} per second)"


def frames(source: Source, *, max_gaussians: Optional[int] = None) -> Frames:
    """Opens a sequence that ``gsvx encode --fps`` made.

    ``source``: a file name, or an object with ``read`` and ``seek``. ``max_gaussians``: refuse groups of more; the
    default follows from their length. ::

        for splats in gsvx.frames("clip.gsvx"):
            ...

    Raises :class:`gsvx.Error` for what is no sequence or a damaged one, OSError for a file that cannot be read.
    """
    return Frames(source, max_gaussians)
