"""Files: those with a name, and objects that are like files."""

from __future__ import annotations

import io
import os
import secrets
import warnings
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, BinaryIO, Dict, Iterator, Tuple, Union, cast

from . import _gsvx
from ._arrays import PathLike, Splats, SplatsLike, checked, from_native

if TYPE_CHECKING:
    from typing_extensions import TypeGuard

#: A file name or an object with ``read`` and ``seek``: an open file, ``io.BytesIO``, an fsspec file.
Source = Union[PathLike, BinaryIO, Any]
#: A file name or an object with ``write``.
Target = Union[PathLike, BinaryIO, Any]
#: Splats, or the name of a file that holds a model or a stream.
ModelLike = Union[SplatsLike, PathLike]


def is_path(value: object) -> TypeGuard[PathLike]:
    return isinstance(value, (str, os.PathLike))


def write(target: Target, data: bytes) -> None:
    """Writes a file. One with a name appears whole or not at all; an existing one is replaced."""
    if not is_path(target):
        _write_all(target, data)
        return
    path = os.fspath(target)
    # Threads of this process may write to the same path.
    partial = f"{path}.{secrets.token_hex(8)}.part"
    try:
        with open(partial, "xb") as file:
            file.write(data)
        os.replace(partial, path)
    except BaseException:
        with suppress(OSError):
            os.remove(partial)
        raise


def _write_all(file: Any, data: bytes) -> None:
    """Writes to an object that may take fewer bytes than it is given, as raw files and sockets do."""
    while True:
        taken = file.write(data)
        if taken is None and not isinstance(file, io.RawIOBase):
            # Many objects with write return nothing.
            return
        if not taken and data:
            raise OSError(f"{name_of(file)}: takes no more bytes; {len(data)} are left")
        if taken >= len(data):
            return
        data = data[taken:]


def check_writable(target: Target) -> None:
    """Raises before long work what would be raised after it."""
    if is_path(target):
        folder = os.path.dirname(os.path.abspath(os.fspath(target)))
        if not os.path.isdir(folder):
            raise FileNotFoundError(f"{os.fspath(target)}: there is no folder {folder}")
    elif not hasattr(target, "write"):
        raise ValueError("path: a file name or an object with write expected")


@contextmanager
def opened(source: Source) -> Iterator[Tuple[BinaryIO, str]]:
    """The open file and its name. A file that was open stays open."""
    if is_path(source):
        with open(source, "rb") as file:
            yield file, os.fspath(source)
    elif hasattr(source, "read") and hasattr(source, "seek"):
        yield cast(BinaryIO, source), name_of(source)
    elif hasattr(source, "open"):
        # What fsspec.open returns.
        with source.open() as file:
            yield file, name_of(source)
    else:
        raise ValueError("path: a file name or an object with read and seek expected")


def name_of(source: Any) -> str:
    name = getattr(source, "path", None) or getattr(source, "name", None)
    return name if isinstance(name, str) else "stream"


def read_model(path: PathLike, *, drop_invalid: bool = False, axes: str = "turn") -> Splats:
    """Reads a model: any format that gsvx knows, such as PLY in the Inria layout, SPZ and .splat, or a stream.

    Gaussians keep the order of the file. ``drop_invalid``: leave out Gaussians with NaN, an infinite mean, scale
    or colour, or a zero quaternion instead of failing, and those with a log-scale or an SH coefficient beyond
    +-18900. Infinite opacities and scales of 0 are valid: they are read
    as the largest or smallest. ``axes``: ``"turn"`` turns SPZ files from the axes that they declare, or else from
    those of the specification, to those of PLY files; ``"keep"`` leaves the numbers as they are, as Niantic's
    ply_to_spz does. A warning says what of the file was not kept, or was read as something else.

    Returns a dict of float32 arrays with gsplat's names; see :func:`gsvx.compress`. ``sh0`` and ``shN`` are
    views of one array.

    Raises :class:`gsvx.Error` for a file that holds no model, OSError for one that cannot be read.
    """
    if axes not in ("turn", "keep"):
        raise ValueError(f'axes: {axes!r}; use "turn" or "keep"')
    arrays, notes = _gsvx.read_model(os.fspath(path), drop_invalid, axes == "keep")
    for note in notes:
        warnings.warn(note, stacklevel=2)
    return from_native(arrays)


def write_model(path: PathLike, splats: SplatsLike) -> None:
    """Writes a model as .ply (every float as it is), .spz (version 4), .sog or .splat (no view dependence): the
    extension says which. Gaussians keep their order, but in .sog. The file appears whole or not at all; an existing one
    is replaced. For streams there is :func:`gsvx.compress`.

    ``splats``: as for :func:`gsvx.compress`.

    Raises ValueError for another extension, OSError if the file cannot be written.
    """
    if not _gsvx.write_model(os.fspath(path), checked(splats)):
        text = "the format does not say that the model is antialiased, so viewers draw it with too much opacity"
        warnings.warn(f"{os.fspath(path)}: {text}", stacklevel=2)


def model(value: ModelLike) -> Dict[str, Any]:
    """Checked splats, read from a file if they are the name of one."""
    if is_path(value):
        return checked(read_model(value))
    return checked(cast(SplatsLike, value))
