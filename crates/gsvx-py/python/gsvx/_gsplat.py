"""The interface of gsplat's PngCompression."""

from __future__ import annotations

import importlib.util
import json
import os
from dataclasses import dataclass, field
from typing import Any, Dict, Mapping, Optional

import numpy as np

from ._cameras import CamerasLike
from ._codec import compress, decompress
from ._reports import Report

_STREAM, _META = "splats.gsvx", "meta.json"


@dataclass
class GsvxCompression:
    """Compresses splats into a folder, with the interface of gsplat's ``PngCompression``: a trainer's
    ``compression_method`` can be this. Unlike that class it leaves its input as it is and crops nothing.

    ``quality``, ``target_bytes``, ``cameras``: as for :func:`gsvx.compress`. ``options``: its other options.
    ``verbose``: print the report. ``report``: that of the last compression.
    """

    quality: Optional[float] = None
    target_bytes: Optional[int] = None
    cameras: Optional[CamerasLike] = None
    options: Dict[str, Any] = field(default_factory=dict)
    verbose: bool = True
    report: Optional[Report] = field(default=None, init=False)

    def compress(self, compress_dir: str, splats: Mapping[str, Any]) -> None:
        """Writes ``splats.gsvx`` and ``meta.json`` into a folder, which is made if it is not there.

        ``splats``: as for :func:`gsvx.compress`; tensors on a GPU and parameters are taken too.
        """
        os.makedirs(compress_dir, exist_ok=True)
        self.report = compress(
            os.path.join(compress_dir, _STREAM),
            splats,
            quality=self.quality,
            target_bytes=self.target_bytes,
            cameras=self.cameras,
            **self.options,
        )
        # A stream does not store SH degrees that are zero; who trains needs all coefficients.
        coefficients = splats["shN"].shape[1] if "shN" in splats else 0
        with open(os.path.join(compress_dir, _META), "w") as file:
            json.dump({"format": "gsvx", "shN": coefficients}, file)
        if self.verbose:
            print(self.report)

    def decompress(self, compress_dir: str) -> Dict[str, Any]:
        """The splats of a folder: tensors of torch if it is installed, else numpy arrays. There may be fewer
        Gaussians than before, and their order is another; ``shN`` has as many coefficients as before."""
        with open(os.path.join(compress_dir, _META)) as file:
            wanted = int(json.load(file)["shN"])
        splats = decompress(os.path.join(compress_dir, _STREAM))
        have = splats["shN"].shape[1]
        if have < wanted:
            n = len(splats["shN"])
            padding = np.zeros((n, wanted - have, 3), np.float32)
            splats["shN"] = np.concatenate([splats["shN"], padding], axis=1)
        if importlib.util.find_spec("torch") is None:
            return dict(splats)
        import torch  # type: ignore[import-not-found,unused-ignore]

        # How a model is drawn is an option of gsplat's trainer, no parameter.
        splats.pop("antialiased", None)
        return {name: torch.from_numpy(np.ascontiguousarray(a)) for name, a in splats.items()}
