"""Cameras: from files, or as arrays."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from . import _gsvx
from ._arrays import PathLike, as_array


@dataclass
class Cameras:
    """Pinhole cameras as arrays, with gsplat's conventions: axes x right, y down, z forward; pixel centres
    at integer + 1/2.

    ``viewmats``: (C, 4, 4), world to camera. ``Ks``: (C, 3, 3), intrinsics in pixels, without skew.
    ``sizes``: (C, 2) or (2,), image width and height in pixels. ``names``: one per camera. ``photos``: files
    with the photos, where they are known. ``lenses``: of each camera None, or COLMAP's name of its lens model
    and the coefficients that follow the principal point. Renders have no lens; photos that are compared with
    them are undistorted. ``near``: (C,) or a number, depth up to which nothing is drawn, world units; 0.2 is that of the
    rasterizers that models are trained with. ``name``: what messages call the cameras.
    """

    viewmats: npt.NDArray[np.float64]
    Ks: npt.NDArray[np.float64]
    sizes: npt.NDArray[np.int64]
    names: List[str] = field(default_factory=list)
    photos: List[str] = field(default_factory=list)
    lenses: List[Optional[Tuple[str, List[float]]]] = field(default_factory=list)
    near: Union[float, npt.NDArray[np.float64]] = 0.2
    name: str = "cameras"

    def __post_init__(self) -> None:
        self.viewmats = as_array(self.viewmats, np.float64, "viewmats")
        self.Ks = as_array(self.Ks, np.float64, "Ks")
        n = len(self.viewmats) if self.viewmats.ndim else 0
        for name, array, shape in [
            ("viewmats", self.viewmats, (n, 4, 4)),
            ("Ks", self.Ks, (n, 3, 3)),
        ]:
            if array.shape != shape:
                raise ValueError(f"{name}: shape {shape} expected, not {array.shape}")
        try:
            sizes = np.broadcast_to(as_array(self.sizes, np.int64, "sizes"), (n, 2))
        except ValueError as error:
            raise ValueError(f"sizes: shape ({n}, 2) or (2,) expected: {error}") from error
        self.sizes = np.ascontiguousarray(sizes)
        try:
            near = np.broadcast_to(as_array(self.near, np.float64, "near"), (n,))
        except ValueError as error:
            raise ValueError(f"near: a number or shape ({n},) expected: {error}") from error
        self.near = np.ascontiguousarray(near)
        if not np.all(self.near >= 0):
            raise ValueError("near: numbers of at least 0 expected")
        if n and not np.array_equal(self.viewmats[:, 3], np.tile([0.0, 0, 0, 1], (n, 1))):
            raise ValueError("viewmats: the last row of each must be 0, 0, 0, 1")
        if n and np.any(self.Ks[:, 0, 1] != 0):
            raise ValueError("Ks: skew is not supported")
        self.names = list(self.names) or [f"camera-{i:04}" for i in range(n)]
        self.lenses = list(self.lenses) or [None] * n
        for what in ("names", "photos", "lenses"):
            have = len(getattr(self, what))
            if have != n and not (what == "photos" and have == 0):
                raise ValueError(f"{what}: {have} of them for {n} cameras")

    def __len__(self) -> int:
        return len(self.viewmats)

    def __getitem__(self, which: Union[slice, Sequence[int], npt.NDArray[Any]]) -> "Cameras":
        """Some of the cameras: a slice, numbers, or a mask."""
        index = np.arange(len(self))[which]

        def pick(values: List[Any]) -> List[Any]:
            return [values[i] for i in index] if values else []

        return Cameras(
            self.viewmats[index],
            self.Ks[index],
            self.sizes[index],
            pick(self.names),
            pick(self.photos),
            pick(self.lenses),
            self.near[index],
            self.name,
        )

    def _native(self) -> Dict[str, Any]:
        return {
            "name": self.name,
            "names": self.names,
            "viewmats": self.viewmats,
            "Ks": self.Ks,
            "sizes": self.sizes,
            "lenses": self.lenses,
            "near": self.near,
            "photos": self.photos,
        }


#: What functions take as cameras: a path, :class:`Cameras`, or the arrays (viewmats, Ks, sizes).
CamerasLike = Union[PathLike, Cameras, Tuple[Any, Any, Any]]


def read_cameras(path: PathLike, split: str = "all") -> Cameras:
    """Reads cameras, sorted by image name.

    ``path``: a scene folder (COLMAP project, output of Inria's trainer, or one with a transforms.json), a
    folder or file in it, a cameras.json or a transforms.json. ``split``: "all"; "test" for the first and every 8th after it, which
    this project and the literature hold out for measuring; "train" for the others. Of a lens that
    distorts ``lenses`` holds the model.

    Raises :class:`gsvx.Error` or OSError.
    """
    cameras = _read(path)
    if split == "all":
        return cameras
    held_out = np.arange(len(cameras)) % 8 == 0
    if split not in ("train", "test"):
        raise ValueError(f"split: use all, train or test, not {split!r}")
    return cameras[held_out if split == "test" else ~held_out]


def _read(path: PathLike) -> Cameras:
    found = _gsvx.read_cameras(os.fspath(path))
    for note in found.pop("notes"):
        warnings.warn(note, stacklevel=3)
    found["photos"] = [os.fspath(photo) for photo in found["photos"]]
    return Cameras(**found, name=os.fspath(path))


def _as_cameras(cameras: CamerasLike, training: bool) -> Cameras:
    """Cameras of any kind; of a path the training views or all. Warns of lenses where renders do not show them."""
    if isinstance(cameras, Cameras):
        return cameras
    if not isinstance(cameras, (str, os.PathLike)):
        try:
            viewmats, intrinsics, sizes = cameras
        except (TypeError, ValueError):
            raise ValueError(
                "cameras: a path, gsvx.Cameras or (viewmats, Ks, sizes) expected"
            ) from None
        return Cameras(viewmats, intrinsics, sizes)
    found = _read(cameras)
    if not len(found):
        raise _gsvx.Error(f"{os.fspath(cameras)}: no cameras")
    bent = [lens for lens in found.lenses if lens]
    if bent and not training:
        warnings.warn(
            f"{os.fspath(cameras)}: {len(bent)} of {len(found)} cameras have lens distortion ({bent[0][0]}), "
            "which renders do not show",
            stacklevel=4,
        )
    if not training:
        return found
    found = found[np.arange(len(found)) % 8 != 0]
    if not len(found):
        raise _gsvx.Error(
            f"{os.fspath(cameras)}: a single camera is held out for measuring; give two or more"
        )
    return found
