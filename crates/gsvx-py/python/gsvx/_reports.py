"""What functions report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List, Optional

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Progress:
    """How far work has come.

    ``stage``: what is being done. ``done`` and ``total``: steps; ``total`` is 0 if it is not known.
    ``values``: figures by name, such as "bytes", "quality", "psnr" (dB), "eta_seconds".
    """

    stage: str
    done: int
    total: int
    values: Dict[str, float]


#: Called on the thread that called the function. An exception from it ends the work.
ProgressCallback = Callable[[Progress], Any]


def _callback(progress: Optional[ProgressCallback]) -> Optional[Callable[..., Any]]:
    if progress is None:
        return None
    return lambda stage, done, total, values: progress(Progress(stage, done, total, values))


@dataclass(frozen=True)
class Estimate:
    """How much less a stream shows than the input: ``psnr`` (dB, 99 for equal pictures), ``ssim`` and
    ``ssimulacra2`` over parts of ``views`` pictures, and what PSNR and SSIMULACRA2 mean in words. With cameras these are the worse of two: at the cameras
    (``at_cameras``, dB) and at views that depend on the model alone (``around``, dB)."""

    psnr: float
    ssim: float
    ssimulacra2: float
    views: int
    meaning: str
    at_cameras: Optional[float] = None
    around: Optional[float] = None


@dataclass(frozen=True)
class Report:
    """What :func:`gsvx.compress` made.

    ``bytes``: length of the stream. ``gaussians``: Gaussians in it, fewer than ``input_gaussians`` where
    some were merged. ``sh_degree``: of the stream; degrees that are zero everywhere are not stored.
    ``quality``: 0 to 100, None for lossless. ``psnr`` (dB) or ``ssimulacra2``: of renders against renders of
    the input, where a target asked for it. ``encodes``: encodings that a search took. ``invalid``, ``pruned``: Gaussians left
    out on request. ``transparent``: those left out that no rasterizer draws (opacity below 1/255).
    ``left_out``: those that cameras see too little of. ``outliers``: Gaussians coded
    bit for bit because they are far away. ``seen_opacity_share``, ``unseen``: with cameras, the share of the
    opacity that they see, and the number of Gaussians that they do not. ``missed``: why the stream misses
    its target, or None. ``parts``: bytes by part of the stream. ``seconds``: time of the encoding.
    ``max_error``: the greatest errors, where bounds were asked for, as measured. ``rows``: if asked for,
    (N,) int64, the row in which :func:`gsvx.decompress` returns each Gaussian of the input;
    merged Gaussians share one, -1 is for those left out. ``estimate``: if asked for, how much is lost; None where
    the pictures show nothing.
    """

    bytes: int
    gaussians: int
    input_gaussians: int
    sh_degree: int
    quality: Optional[float]
    psnr: Optional[float]
    ssimulacra2: Optional[float]
    encodes: int
    invalid: int
    transparent: int
    pruned: int
    left_out: int
    outliers: int
    seen_opacity_share: Optional[float]
    unseen: Optional[int]
    missed: Optional[str]
    warnings: List[str]
    seconds: float
    parts: Dict[str, int]
    max_error: Optional[Dict[str, float]] = None
    estimate: Optional[Estimate] = None
    rows: Optional[npt.NDArray[np.int64]] = field(default=None, repr=False, compare=False)

    @property
    def bits_per_gaussian(self) -> float:
        """Bits of the stream per Gaussian in it."""
        return 8 * self.bytes / max(self.gaussians, 1)


@dataclass(frozen=True)
class TuneReport:
    """What :func:`gsvx.tune` made.

    ``psnr`` (dB), ``ssim`` and ``ssimulacra2``: of the stream at views kept aside; ``input_psnr`` and so on are those of
    the input model. SSIMULACRA2 is NaN for pictures below 8 pixels.
    ``elsewhere_psnr``: against renders of the input model at views beside the cameras' path or around the model,
    whichever is worse; None if nothing is seen there.
    ``distilled``: whether the model was tuned to its own renders. ``steps``, ``seconds``: how long, since the start of
    the run. ``further``: with ``qualities``, reports of the other streams that the call made. The others are as in
    :class:`Report`.
    """

    bytes: int
    gaussians: int
    sh_degree: int
    outliers: int
    psnr: float
    ssim: float
    ssimulacra2: float
    input_psnr: float
    input_ssim: float
    input_ssimulacra2: float
    elsewhere_psnr: Optional[float]
    quality: float
    distilled: bool
    steps: int
    seconds: float
    missed: Optional[str]
    warnings: List[str]
    parts: Dict[str, int]
    further: List["TuneReport"] = field(default_factory=list, repr=False)


@dataclass(frozen=True)
class ViewScore:
    """How alike two renders are: ``psnr`` in dB, infinite for equal ones, ``ssim``, and ``ssimulacra2``: 100 for equal
    ones, NaN below 8 pixels."""

    name: str
    psnr: float
    ssim: float
    ssimulacra2: float


@dataclass(frozen=True)
class Comparison:
    """How alike two models look: ``psnr`` (dB), ``ssim`` and ``ssimulacra2`` are means over ``views``. ``gaussians``
    and ``sh_degree`` are those of both models."""

    psnr: float
    ssim: float
    ssimulacra2: float
    views: List[ViewScore] = field(repr=False)
    gaussians: "tuple[int, int]"
    sh_degree: "tuple[int, int]"

    @property
    def worst(self) -> ViewScore:
        """The view of the lowest PSNR."""
        return min(self.views, key=lambda view: view.psnr)
