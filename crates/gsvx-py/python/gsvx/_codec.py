"""Splats to streams and back."""

from __future__ import annotations

import io
import re
import warnings
from typing import Any, Dict, Mapping, Optional, Sequence, Tuple, Union

from . import _gsvx
from ._arrays import Splats, check_numbers, from_native, joined
from ._cameras import CamerasLike, _as_cameras
from ._files import ModelLike, Source, Target, check_writable, model, opened, write
from ._reports import Estimate, ProgressCallback, Report, _callback
from ._stream import open as open_stream

#: Qualities by name, as those of the command.
PRESETS: Dict[str, float] = _gsvx.PRESETS


def compress(
    path: Target,
    splats: ModelLike,
    *,
    quality: Optional[float] = None,
    preset: Optional[str] = None,
    target_bytes: Optional[int] = None,
    target_psnr: Optional[float] = None,
    target_ssimulacra2: Optional[float] = None,
    max_error: Optional[Union[float, Mapping[str, float]]] = None,
    lossless: bool = False,
    cameras: Optional[CamerasLike] = None,
    drop_unseen: bool = False,
    drop_invalid: bool = False,
    antialiased: bool = False,
    web: bool = False,
    lod: bool = False,
    max_sh_degree: int = 3,
    prune: float = 0.0,
    depth: Optional[int] = None,
    j_low: Optional[int] = None,
    rows: bool = False,
    estimate: bool = False,
    progress: Optional[ProgressCallback] = None,
) -> Report:
    """Compresses splats into a stream. It has the bytes that ``gsvx encode`` makes of the same model.

    ``path``: the file to write, or an object with ``write``. A file appears whole or not at all; an existing
    one is replaced.

    ``splats``: a dict of arrays with gsplat's names, as they are in training, before any activation:

    ============= ========= ==========================================================
    means         (N, 3)    positions, world units
    scales        (N, 3)    natural logarithms of the standard deviations, world units
    quats         (N, 4)    rotations, w x y z, not necessarily of length 1
    opacities     (N,)      logits
    sh0           (N, 1, 3) SH coefficients of degree 0, RGB
    shN           (N, K, 3) the others; K is 0, 3, 8 or 15. May be left out
    ============= ========= ==========================================================

    ``antialiased``, in the dict or as an argument: the model is trained with gsplat's
    ``rasterize_mode="antialiased"``, and is to be drawn so. The stream keeps it.

    Arrays of numpy, tensors of torch, or anything with ``__array__`` or ``__dlpack__``; float32 is read
    as it is, other types are converted. They are not changed. Or the name of a file that
    :func:`gsvx.read_model` reads.

    One of these decides the size (default: quality 80): ``quality``, 0 (smallest) to 100 (best);
    ``preset``, "tiny", "web", "high" or "archive"; ``target_bytes``, the best stream of at most so many
    bytes; ``target_psnr``, the smallest stream whose renders reach so many dB against renders of the input,
    with ``cameras``; ``target_ssimulacra2``, the same by SSIMULACRA2, 90 where no difference is seen; ``max_error``, near-lossless: nothing is merged, and no attribute is off by more than this
    number, or than those of a dict: "mean", of positions, in standard deviations along the Gaussian's longest
    axis; "opacity", from 0 to 1; "shape", of the logarithms of the scales, with the rotation; "sh", of each
    SH coefficient; ``lossless``, every float bit for bit. A stream that misses its target is written
    too: a warning and ``Report.missed`` say why.

    ``cameras``: what they see gets more bits. A path, of which the training views count (see
    :func:`gsvx.read_cameras`), :class:`gsvx.Cameras`, or (viewmats, Ks, sizes). ``drop_unseen``: leave out
    what they see too little of to pay for its bits.

    ``web``: what a web page wants (quality 50 if none is given, a coarse scene first, small chunks).
    ``lod``: store a coarse scene first. ``max_sh_degree``: highest SH degree to keep. ``prune``: leave out
    this fraction of the Gaussians first, the least important. ``drop_invalid``: leave out Gaussians with
    NaN, infinity or a zero quaternion instead of failing, and those with a log-scale or an SH coefficient beyond
    +-18900.

    For experts: ``depth``, uniform voxelization at this octree depth; ``j_low``, adaptively by the paper's
    criteria from this depth to ``depth``.

    The order of the Gaussians changes: they come back in Morton order, outliers last, and Gaussians of one
    voxel are merged. With ``rows`` the report says which row each became. With ``estimate`` it says how much
    less the stream shows, from a few pictures, as the command does; that takes time and memory of its own.

    ``progress``: called with a :class:`gsvx.Progress` now and then. Ctrl-C ends the work, and nothing is
    written.

    Raises ValueError for arguments that make no sense, :class:`gsvx.Error` for a model or cameras that
    cannot be used, OSError if a file cannot be read or written.
    """
    check_writable(path)
    arrays = model(splats)
    if antialiased:
        arrays["antialiased"] = True
    stream, report = _encode(
        arrays,
        cameras,
        progress,
        quality=quality,
        preset=preset,
        target_bytes=target_bytes,
        target_psnr=target_psnr,
        target_ssimulacra2=target_ssimulacra2,
        max_error=_bounds(max_error),
        lossless=lossless,
        drop_unseen=drop_unseen,
        drop_invalid=drop_invalid,
        web=web,
        lod=lod,
        max_sh_degree=max_sh_degree,
        prune=prune,
        depth=depth,
        j_low=j_low,
        rows=rows,
        estimate=estimate,
    )
    write(path, stream)
    for warning in [*report.warnings, *filter(None, [report.missed])]:
        warnings.warn(warning, stacklevel=2)
    return report


def compress_to_bytes(splats: ModelLike, **options: Any) -> bytes:
    """As :func:`gsvx.compress`, with the same options; returns the stream. For its report, pass an
    ``io.BytesIO`` to :func:`gsvx.compress`."""
    out = io.BytesIO()
    compress(out, splats, **options)
    return out.getvalue()


def _encode(
    splats: Splats,
    cameras: Optional[CamerasLike],
    progress: Optional[ProgressCallback],
    *,
    preset: Optional[str],
    web: bool,
    **options: Any,
) -> Tuple[bytes, Report]:
    _check(cameras, preset, web, options)
    if preset is not None:
        options["quality"] = PRESETS[preset]
    elif web and options["quality"] is None:
        options["quality"] = PRESETS["web"]
    options["web"] = web
    views = None if cameras is None else _as_cameras(cameras, training=True)._native()
    stream, report = _gsvx.compress(splats, options, views, _callback(progress))
    if report["estimate"] is not None:
        report["estimate"] = Estimate(*report["estimate"])
    return stream, Report(**report)


#: Targets that are measured at cameras.
_LIKENESS = ("target_psnr", "target_ssimulacra2")


def _check(
    cameras: Optional[CamerasLike],
    preset: Optional[str],
    web: bool,
    options: Dict[str, Any],
) -> None:
    """Arguments, and combinations of them, that make no sense."""
    wholes = ("target_bytes", "max_sh_degree", "depth", "j_low")
    check_numbers(
        {name: options[name] for name in wholes},
        {name: options[name] for name in ("quality", *_LIKENESS, "prune")},
    )
    for name in ("max_sh_degree", "prune"):
        if options[name] is None:
            raise ValueError(f"{name}: a number expected, not None")
    rates = ("quality", "target_bytes", *_LIKENESS, "max_error")
    given = [name for name in rates if options[name] is not None]
    if preset is not None:
        given.append("preset")
        if preset not in PRESETS:
            raise ValueError(f"preset: use {', '.join(PRESETS)}, not {preset!r}")
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)}: only one of them can be given")
    needing = [name for name in _LIKENESS if options[name] is not None]
    needing += ["drop_unseen"] if options["drop_unseen"] else []
    if needing and cameras is None:
        raise ValueError(f"{needing[0]}: needs cameras")
    if options["j_low"] is not None and options["depth"] is None:
        raise ValueError("j_low: needs depth")
    if not 0 <= options["max_sh_degree"] <= 3:
        raise ValueError(f"max_sh_degree is {options['max_sh_degree']}, must be 0 to 3")
    for name in ("depth", "j_low"):
        if options[name] is not None and not 1 <= options[name] <= 21:
            raise ValueError(f"{name} is {options[name]}, must be 1 to 21")
    if options["max_error"] is not None:
        changed = ["cameras"] * (cameras is not None) + ["depth"] * (options["depth"] is not None)
        changed += ["web"] * web
        if changed:
            raise ValueError(f"max_error: cannot be used with {', '.join(changed)}")
    if options["lossless"]:
        changed = given + ["web"] * web + ["lod"] * options["lod"] + ["prune"] * (options["prune"] != 0)
        changed += ["cameras"] * (cameras is not None) + ["depth"] * (options["depth"] is not None)
        changed += ["max_sh_degree"] * (options["max_sh_degree"] != 3)
        if changed:
            raise ValueError(f"lossless: cannot be used with {', '.join(changed)}")


def _bounds(
    error: Optional[Union[float, Mapping[str, float]]],
) -> Optional[Tuple[float, float, float, float]]:
    """Bounds on mean, opacity, shape and SH."""
    if not isinstance(error, Mapping):
        check_numbers({}, {"max_error": error})
        return None if error is None else (error, error, error, error)
    names = ("mean", "opacity", "shape", "sh")
    if set(error) != set(names):
        raise ValueError(f"max_error: a number, or one for each of {', '.join(names)} expected")
    check_numbers({}, {f"max_error: {name}": error[name] for name in names})
    return (error["mean"], error["opacity"], error["shape"], error["sh"])


def decompress(
    path: Source,
    *,
    chunks: Optional[Sequence[int]] = None,
    max_sh_degree: Optional[int] = None,
    lod: int = 0,
    salvage: bool = False,
    max_gaussians: Optional[int] = None,
) -> Splats:
    """Decompresses a stream.

    ``path``: a file name, or an object with ``read`` and ``seek``. ``chunks``: only the chunks of these
    numbers, in this order; of the stream only their bytes are read (see :func:`gsvx.open`).
    ``max_sh_degree``: highest SH degree to decode; less is faster. ``lod``: level of detail, 0 is the finest.
    ``salvage``: decode what is whole of a truncated or damaged stream instead of failing; warnings
    say what is missing. ``max_gaussians``: refuse streams of more; the default follows from the length.

    Returns a dict of float32 arrays with gsplat's names, and ``antialiased`` if it is true; see :func:`gsvx.compress`. Gaussians come in Morton
    order, outliers last. ``sh0`` and ``shN`` are views of one array.

    Raises :class:`gsvx.Error` for what is no stream or a damaged one, OSError for a file that cannot be
    read.
    """
    if chunks is not None:
        if lod or salvage:
            raise ValueError("chunks: cannot be used with lod or salvage")
        with open_stream(path, max_gaussians=max_gaussians) as stream:
            wanted = [stream.chunks[number].gaussians for number in chunks]
            if max_gaussians is not None and sum(wanted) > max_gaussians:
                raise _gsvx.Error(f"{sum(wanted)} Gaussians, more than the limit of {max_gaussians}")
            parts = [stream.read(number, max_sh_degree=max_sh_degree) for number in chunks]
            return joined(parts, min(stream.sh_degree, _degree(max_sh_degree)))
    with opened(path) as (file, name):
        file.seek(0)
        data = file.read()
    return _decode(data, name, max_sh_degree, lod, salvage, max_gaussians)


def decompress_bytes(
    data: Any,
    *,
    max_sh_degree: Optional[int] = None,
    lod: int = 0,
    salvage: bool = False,
    max_gaussians: Optional[int] = None,
) -> Splats:
    """As :func:`gsvx.decompress`, from bytes, a bytearray or a memoryview."""
    if not isinstance(data, (bytes, bytearray, memoryview)):
        raise ValueError(f"data: bytes expected, not {type(data).__name__}")
    return _decode(bytes(data), "", max_sh_degree, lod, salvage, max_gaussians)


def _degree(max_sh_degree: Optional[int]) -> int:
    check_numbers({"max_sh_degree": max_sh_degree}, {})
    degree = 3 if max_sh_degree is None else max_sh_degree
    if not 0 <= degree <= 3:
        raise ValueError(f"max_sh_degree is {degree}, must be 0 to 3")
    return degree


def _decode(
    data: bytes,
    name: str,
    max_sh_degree: Optional[int],
    lod: int,
    salvage: bool,
    max_gaussians: Optional[int],
) -> Splats:
    degree = _degree(max_sh_degree)
    check_numbers({"lod": lod, "max_gaussians": max_gaussians}, {})
    if not 0 <= lod <= 255:
        raise ValueError(f"lod is {lod}, must be 0 to 255")
    wanted = dict(
        max_sh_degree=degree,
        lod=lod,
        salvage=salvage,
        max_gaussians=max_gaussians,
    )
    arrays, skipped = _gsvx.decompress(data, name, wanted)
    for line in skipped:
        if not line.endswith("not asked for"):
            warnings.warn(line, stacklevel=3)
    return from_native(arrays)
