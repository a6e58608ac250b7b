"""Fine-tune with the codec in the loop."""

from __future__ import annotations

import os
import warnings
from typing import Any, Dict, List, Optional, Sequence

import numpy as np

from . import _gsvx
from ._arrays import PathLike, as_array, check_numbers
from ._cameras import Cameras, CamerasLike, _as_cameras
from ._files import ModelLike, Target, check_writable, is_path, model, write
from ._reports import ProgressCallback, TuneReport, _callback


def tune(
    path: Target,
    splats: ModelLike,
    cameras: CamerasLike,
    photos: Optional[Sequence[Any]] = None,
    *,
    quality: Optional[float] = None,
    target_bytes: Optional[int] = None,
    target_psnr: Optional[float] = None,
    effort: str = "normal",
    distil: bool = False,
    force_photos: bool = False,
    drop_unseen: bool = False,
    lod: bool = False,
    web: bool = False,
    checkpoint: Optional[PathLike] = None,
    seed: int = 0,
    drop_invalid: bool = False,
    progress: Optional[ProgressCallback] = None,
) -> TuneReport:
    """Tunes splats for a smaller stream of equal quality, and writes the stream: ``gsvx tune``.

    ``path``, ``splats``: as for :func:`gsvx.compress`.

    ``cameras``: a scene folder, of which the training views with their photos count, or cameras as for
    :func:`gsvx.compress`. ``photos``: one per camera: arrays (height, width, 3), uint8 or floats from 0 to 1, or
    files (PNG, JPEG, WebP). Without photos, or with ``distil``, the model is tuned to its own renders.
    Photos that seem to be of other views than their cameras' are refused without ``force_photos``.

    One of these is the target (default: quality 58): ``quality``, 0 to 100; ``target_bytes``;
    ``target_psnr``, dB against the photos at views kept aside. ``effort``: "quick" (45 seconds for 120,000
    Gaussians and small photos on one core), "normal" (3 minutes) or "long" (10 minutes). ``seed``: of the
    order of the views. ``drop_unseen`` leaves out what the views do not show: fewer bytes, and good only where the
    cameras stand. ``lod`` stores a coarse scene first, and ``web`` also makes small chunks; the bytes count.
    ``checkpoint``: file that keeps what is needed to go on after an interruption; an
    existing one is continued.

    Ctrl-C ends the work, and no stream is written; the checkpoint stays. To see the tuned model, decompress
    the stream.

    Raises as :func:`gsvx.compress`.
    """
    check_writable(path)
    _check(quality, target_bytes, target_psnr, effort)
    check_numbers({"seed": seed}, {})
    views = _as_cameras(cameras, training=True)
    used = None if distil or photos is None else _photos(photos)
    options = dict(
        quality=quality,
        target_bytes=target_bytes,
        target_psnr=target_psnr,
        effort=effort,
        seed=seed,
        distil=distil,
        force_photos=force_photos,
        drop_unseen=drop_unseen,
        lod=lod,
        web=web,
        checkpoint=None if checkpoint is None else os.fspath(checkpoint),
        drop_invalid=drop_invalid,
    )
    native = views._native()
    stream, report = _gsvx.tune(model(splats), native, used, options, _callback(progress))
    write(path, stream)
    result = TuneReport(**report)
    for warning in [*result.warnings, *filter(None, [result.missed])]:
        warnings.warn(warning, stacklevel=2)
    return result


def _check(
    quality: Optional[float],
    target_bytes: Optional[int],
    target_psnr: Optional[float],
    effort: str,
) -> None:
    """Arguments, and combinations of them, that make no sense."""
    check_numbers(
        {"target_bytes": target_bytes}, {"quality": quality, "target_psnr": target_psnr}
    )
    targets = dict(quality=quality, target_bytes=target_bytes, target_psnr=target_psnr)
    given = [name for name, value in targets.items() if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)}: only one of them can be given")
    if effort not in ("quick", "normal", "long"):
        raise ValueError(f"effort: use quick, normal or long, not {effort!r}")


def _photos(photos: Sequence[Any]) -> Sequence[Any]:
    """Photos as arrays or names of files."""
    used: List[Any] = []
    for photo in photos:
        if is_path(photo):
            used.append(os.fspath(photo))
            continue
        kind = np.uint8 if str(getattr(photo, "dtype", "")).endswith("uint8") else np.float32
        array = as_array(photo, kind, "photos")
        if array.ndim != 3:
            raise ValueError(f"photos: arrays (height, width, 3) expected, not {array.shape}")
        used.append(array)
    return used
