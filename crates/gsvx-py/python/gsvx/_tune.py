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
    qualities: Optional[Sequence[float]] = None,
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

    One of these is the target (default: quality 58): ``quality``, 0 to 100; ``qualities``, several, where "small.gsvx"
    becomes "small-q42.gsvx", "small-q58.gsvx" ..., five in about twice the time of one; ``target_bytes``;
    ``target_psnr``, dB against the photos at views kept aside. ``effort``: "quick" (45 seconds for 120,000
    Gaussians and small photos on one core), "normal" (3 minutes) or "long" (10 minutes). ``seed``: of the
    order of the views. ``drop_unseen`` leaves out what the views do not show: fewer bytes, and good only where the
    cameras stand. ``lod`` stores a coarse scene first, and ``web`` also makes small chunks; the bytes count.
    ``checkpoint``: file that keeps what is needed to go on after an interruption; an
    existing one is continued.

    Ctrl-C ends the work, and the stream under way is not written; the checkpoint stays. To see the tuned model, decompress
    the stream.

    Raises as :func:`gsvx.compress`.
    """
    check_writable(path)
    wanted = _check(path, quality, qualities, target_bytes, target_psnr, effort)
    check_numbers({"seed": seed}, {})
    views = _as_cameras(cameras, training=True)
    used = None if distil or photos is None else _photos(photos)
    options = dict(
        qualities=wanted,
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
    reports: List[TuneReport] = []

    def made(stream: bytes, report: Dict[str, Any]) -> None:
        target = path
        if qualities is not None and is_path(path):
            target = _named(path, report["quality"])
        write(target, stream)
        reports.append(TuneReport(**report))

    _gsvx.tune(model(splats), native, used, options, made, _callback(progress))
    for warning in [w for r in reports for w in [*r.warnings, *filter(None, [r.missed])]]:
        warnings.warn(warning, stacklevel=2)
    reports[0].further.extend(reports[1:])
    return reports[0]


def _named(path: PathLike, quality: float) -> str:
    """The file of one of several streams."""
    stem, extension = os.path.splitext(os.fspath(path))
    return f"{stem}-q{quality:g}{extension}"


def _check(
    path: Target,
    quality: Optional[float],
    qualities: Optional[Sequence[float]],
    target_bytes: Optional[int],
    target_psnr: Optional[float],
    effort: str,
) -> List[float]:
    """Refuses arguments, and combinations of them, that make no sense. The qualities of the streams, the highest first."""
    check_numbers(
        {"target_bytes": target_bytes}, {"quality": quality, "target_psnr": target_psnr}
    )
    for one in qualities or []:
        check_numbers({}, {"qualities": one})
    targets = dict(
        quality=quality, qualities=qualities, target_bytes=target_bytes, target_psnr=target_psnr
    )
    given = [name for name, value in targets.items() if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)}: only one of them can be given")
    if qualities is not None and (len(qualities) == 0 or not is_path(path)):
        raise ValueError("qualities: at least one expected, and the name of a file as path")
    if effort not in ("quick", "normal", "long"):
        raise ValueError(f"effort: use quick, normal or long, not {effort!r}")
    wanted = [quality] if quality is not None else qualities or []
    return sorted({float(one) for one in wanted}, reverse=True)


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
