"""Splats: what is accepted as such, and what is handed to the compiled part."""

from __future__ import annotations

import operator
import os
from typing import Any, Dict, Mapping, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

#: A dict of arrays with gsplat's names, and ``antialiased`` if it is true. See :func:`gsvx.compress`.
Splats = Dict[str, Any]
#: What functions take as splats: numpy arrays, torch tensors, or anything with ``__array__`` or
#: ``__dlpack__``.
SplatsLike = Mapping[str, Any]
#: A file name.
PathLike = Union[str, "os.PathLike[str]"]

#: Names and shapes; N is the number of Gaussians, None stands for any number.
_SHAPES: Dict[str, Tuple[Any, ...]] = {
    "means": (3,),
    "scales": (3,),
    "quats": (4,),
    "opacities": (),
    "sh0": (1, 3),
    "shN": (None, 3),
}
#: True for a model that is trained with gsplat's ``rasterize_mode="antialiased"``.
_MARK = "antialiased"
#: SH coefficients beyond the first, by degree.
_COEFFICIENTS = (0, 3, 8, 15)


def check_numbers(wholes: Mapping[str, Any], others: Mapping[str, Any]) -> None:
    """Refuses arguments that are no numbers; ``wholes`` must be whole and not negative. None is no argument."""
    for name, value in wholes.items():
        if value is not None and not (hasattr(value, "__index__") and operator.index(value) >= 0):
            raise ValueError(f"{name}: a whole number expected, not {value!r}")
    for name, value in others.items():
        is_number = hasattr(value, "__float__") or hasattr(value, "__index__")
        if value is not None and not is_number:
            raise ValueError(f"{name}: a number expected, not {value!r}")


def as_array(value: Any, dtype: Any, name: str) -> npt.NDArray[Any]:
    """An aligned numpy array of a type. The memory is the caller's where that is possible."""
    # Tensors of torch: numpy takes none that require gradients or lie on a GPU.
    if hasattr(value, "detach"):
        value = value.detach()
    if hasattr(value, "cpu"):
        value = value.cpu()
    if not hasattr(value, "__array__") and hasattr(value, "__dlpack__"):
        value = np.from_dlpack(value)
    try:
        array = np.asarray(value)
        # Casts that drop an imaginary part, or make numbers of dates, texts and records, are none.
        if array.dtype.kind not in "biuf" and not np.can_cast(array.dtype, np.float64):
            raise TypeError(f"its type is {array.dtype}")
        return np.require(array, dtype=dtype, requirements="A")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: no array of numbers: {error}") from error


def checked(splats: SplatsLike) -> Splats:
    """The arrays, as float32 of the right shapes. The caller's arrays are not changed."""
    if not hasattr(splats, "keys"):
        raise ValueError("splats: a dict of arrays expected, with " + ", ".join(_SHAPES))
    given = set(splats.keys())
    # Models of SH degree 0 often have no shN.
    missing = [name for name in _SHAPES if name not in given and name != "shN"]
    if missing:
        raise ValueError(f"splats: {', '.join(missing)} missing")
    unknown = sorted(given - set(_SHAPES) - {_MARK})
    if unknown:
        raise ValueError(
            f"splats: {', '.join(unknown)} cannot be kept; a model has {', '.join(_SHAPES)}"
        )
    arrays = {name: as_array(splats[name], np.float32, name) for name in _SHAPES if name in given}
    n = len(arrays["means"]) if arrays["means"].ndim else 0
    arrays.setdefault("shN", np.empty((n, 0, 3), np.float32))
    for name, rest in _SHAPES.items():
        shape = arrays[name].shape
        fits = len(shape) == 1 + len(rest) and shape[0] == n
        if not fits or any(r is not None and r != s for r, s in zip(rest, shape[1:])):
            text = ", ".join(["N", *("K" if r is None else str(r) for r in rest)])
            text += "," if not rest else ""
            raise ValueError(f"{name}: shape ({text}) with N = {n} expected, not {shape}")
    antialiased = bool(splats[_MARK]) if _MARK in given else False
    if arrays["shN"].shape[1] not in _COEFFICIENTS:
        k = arrays["shN"].shape[1]
        raise ValueError(f"shN: K of 0, 3, 8 or 15 expected (SH degree 0 to 3), not {k}")
    return {**arrays, _MARK: antialiased}


def from_native(arrays: Dict[str, Any]) -> Splats:
    """Splits SH into sh0 and shN: views of one array, without a copy."""
    if not arrays[_MARK]:
        del arrays[_MARK]
    sh = arrays.pop("sh")
    arrays["sh0"], arrays["shN"] = sh[:, :1], sh[:, 1:]
    return arrays


def joined(parts: Sequence[Splats], sh_degree: int) -> Splats:
    """Splats one after another, at an SH degree; coefficients that a part lacks are 0."""
    k = _COEFFICIENTS[sh_degree]
    out: Splats = {}
    for name, rest in _SHAPES.items():
        if name != "shN":
            empty = np.empty((0, *rest), np.float32)
            out[name] = np.concatenate([empty, *(part[name] for part in parts)])
    out["shN"] = np.zeros((len(out["means"]), k, 3), np.float32)
    at = 0
    for part in parts:
        rows, have = len(part["means"]), min(k, part["shN"].shape[1])
        out["shN"][at : at + rows, :have] = part["shN"][:, :have]
        at += rows
    if any(part.get(_MARK) for part in parts):
        out[_MARK] = True
    return out
