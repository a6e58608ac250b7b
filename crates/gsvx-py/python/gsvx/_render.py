"""Cameras around a model, renders, and how alike two models look."""

from __future__ import annotations

from typing import List, Optional, Sequence, Tuple, cast

import numpy as np
import numpy.typing as npt

from . import _gsvx
from ._cameras import Cameras, CamerasLike, _as_cameras
from ._files import ModelLike, model
from ._reports import Comparison, ProgressCallback, ViewScore, _callback


def orbit(
    splats: ModelLike,
    count: int,
    *,
    size: Tuple[int, int] = (640, 480),
    fov: float = 60.0,
    up: Optional[Sequence[float]] = None,
    radius: Optional[float] = None,
    elevation: Optional[float] = None,
    full_circle: bool = False,
) -> Cameras:
    """Cameras around what splats show, as those of ``gsvx render --orbit``: for models that have none.

    They stand on a circle, or where the model is seen from one side only, on an arc. The first is the one that sees
    most.

    ``splats``: as for :func:`gsvx.compress`. ``size``: image width and height in pixels. ``fov``: horizontal field
    of view in degrees. ``up``: a direction (x, y, z). ``radius``: distance from the centre in world units.
    ``elevation``: degrees above the horizon. What is None is found; up is then -y, leaning where clearly more
    is seen then. ``full_circle``: the whole circle in any case.
    """
    width, height = (int(v) for v in size)
    if not (1 <= count <= 3600 and 1 <= width <= 8192 and 1 <= height <= 8192):
        raise ValueError("count: use 1 to 3600; size: use 1 to 8192 each")
    if not 1 <= fov <= 170:
        raise ValueError(f"fov is {fov}, must be 1 to 170 degrees")
    if radius is not None and not 0 < radius < float("inf"):
        raise ValueError(f"radius is {radius}, must be above 0")
    if elevation is not None and not -90 < elevation < 90:
        raise ValueError(f"elevation is {elevation}, must be between -90 and 90 degrees")
    direction = None if up is None else [float(v) for v in up]
    if direction is not None and not (len(direction) == 3 and 0 < np.linalg.norm(direction) < np.inf):
        raise ValueError("up: use three numbers that are not all 0")
    wanted = dict(
        count=count,
        size=(width, height),
        field_of_view=fov,
        up=direction,
        radius=radius,
        elevation=elevation,
        full_circle=full_circle,
    )
    found = _gsvx.orbit(model(splats), wanted)
    return Cameras(**found, name="orbit")


def render(
    splats: ModelLike,
    cameras: CamerasLike,
    *,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    progress: Optional[ProgressCallback] = None,
) -> List[npt.NDArray[np.float32]]:
    """Draws splats on the CPU.

    ``splats``: as for :func:`gsvx.compress`. ``cameras``: :class:`gsvx.Cameras`, (viewmats, Ks, sizes), or a
    path, of which all views count. ``background``: red, green, blue from 0 to 1.

    Returns for each camera an array (height, width, 3), float32, 0 for black and 1 for white, not clamped.
    """
    colour = [float(v) for v in background]
    if len(colour) != 3 or not all(0 <= v <= 1 for v in colour):
        raise ValueError("background: use three numbers from 0 to 1")
    views = _as_cameras(cameras, training=False)._native()
    return _gsvx.render(model(splats), views, colour, _callback(progress))


def compare(
    reference: ModelLike,
    splats: ModelLike,
    cameras: CamerasLike,
    *,
    progress: Optional[ProgressCallback] = None,
) -> Comparison:
    """Compares the renders of two models: PSNR, SSIM and SSIMULACRA2 of those of ``splats`` against those of
    ``reference``, values clamped to 0 to 1.

    ``reference``, ``splats``: as for :func:`gsvx.compress`, or names of files. ``cameras``: as for
    :func:`gsvx.render`.
    """
    views = _as_cameras(cameras, training=False)
    models = (model(reference), model(splats))
    scores = _gsvx.compare(*models, views._native(), _callback(progress))
    psnr, ssim, ssimulacra2 = np.mean(np.asarray(scores), axis=0)
    count = tuple(len(m["means"]) for m in models)
    degree = tuple({0: 0, 3: 1, 8: 2, 15: 3}[m["shN"].shape[1]] for m in models)
    return Comparison(
        psnr=float(psnr),
        ssim=float(ssim),
        ssimulacra2=float(ssimulacra2),
        views=[ViewScore(name, *score) for name, score in zip(views.names, scores)],
        gaussians=cast(Tuple[int, int], count),
        sh_degree=cast(Tuple[int, int], degree),
    )
