"""Renders, and how alike two models look."""

from __future__ import annotations

from typing import List, Optional, Sequence, Tuple, cast

import numpy as np
import numpy.typing as npt

from . import _gsvx
from ._cameras import CamerasLike, _as_cameras
from ._files import ModelLike, model
from ._reports import Comparison, ProgressCallback, ViewScore, _callback


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
    """Compares the renders of two models: PSNR and SSIM of those of ``splats`` against those of ``reference``,
    values clamped to 0 to 1.

    ``reference``, ``splats``: as for :func:`gsvx.compress`, or names of files. ``cameras``: as for
    :func:`gsvx.render`.
    """
    views = _as_cameras(cameras, training=False)
    models = (model(reference), model(splats))
    scores = _gsvx.compare(*models, views._native(), _callback(progress))
    psnr, ssim = np.mean(np.asarray(scores), axis=0)
    count = tuple(len(m["means"]) for m in models)
    degree = tuple({0: 0, 3: 1, 8: 2, 15: 3}[m["shN"].shape[1]] for m in models)
    return Comparison(
        psnr=float(psnr),
        ssim=float(ssim),
        views=[ViewScore(name, *score) for name, score in zip(views.names, scores)],
        gaussians=cast(Tuple[int, int], count),
        sh_degree=cast(Tuple[int, int], degree),
    )
