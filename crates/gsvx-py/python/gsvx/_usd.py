"""OpenUSD: scenes as ``ParticleField3DGaussianSplat`` prims, which OpenUSD has since 26.03."""

from __future__ import annotations

import os
import secrets
import warnings
from contextlib import suppress
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from . import _gsvx
from ._arrays import PathLike, Splats, joined
from ._files import ModelLike, check_writable, model

#: Type of a prim that is a scene.
_TYPE = "ParticleField3DGaussianSplat"
#: Opacities whose logits float32 holds: those of 0 and 1 are infinite, and are read as the nearest ones.
_LEAST, _MOST = 1e-30, 1.0 - 2.0**-24
#: Least standard deviation that float32 holds to full precision: 0 has no logarithm.
_LEAST_SCALE = float(np.finfo(np.float32).tiny)
#: A Gaussian ends where a rasterizer stops drawing it.
_RADIUS = 3.0


def to_usd(splats: ModelLike, path: PathLike, *, up_axis: str = "Y", meters_per_unit: float = 1.0) -> None:
    """Writes splats as an OpenUSD stage with one ``ParticleField3DGaussianSplat``, which is its default prim.

    ``splats``: as for :func:`gsvx.compress`, or the name of a stream or a model. ``path``: a name in ``.usda`` (text),
    ``.usdc`` or ``.usd`` (binary). The file appears whole or not at all; an existing one is replaced.

    ``up_axis`` ("Y" or "Z") is written as the stage's. Models of 3DGS have y down and z forward, so an operation of
    the prim turns it, by 180 or -90 degrees about x, and its arrays are those of the model. ``meters_per_unit``: length of
    the model's unit. Logits beyond about 16 come back smaller: float32 has no opacity between theirs and 1.

    The arrays are float32: ``positions``, ``scales`` (exponentials of the logarithms), ``opacities`` (0 to 1),
    ``orientations`` (of length 1, real part first), SH coefficients as RGB triples, Gaussian by Gaussian in the order of
    sh0 and shN, and ``extent`` to three standard deviations.

    Raises ImportError without usd-core, ValueError for arguments that make no sense or splats that USD cannot hold,
    OSError if the file cannot be written.
    """
    Gf, Sdf, Tf, Usd, UsdGeom, UsdVol, Vt = _pxr()
    name = os.fspath(path)
    extension = os.path.splitext(name)[1].lower()
    if extension not in (".usd", ".usda", ".usdc"):
        raise ValueError(f"{name}: name it .usd, .usda or .usdc")
    if up_axis not in ("Y", "Z"):
        raise ValueError(f'up_axis: {up_axis!r}; use "Y" or "Z"')
    if not (0 < meters_per_unit < float("inf")):
        raise ValueError(f"meters_per_unit is {meters_per_unit}, must be above 0")
    check_writable(path)
    arrays = model(splats)
    if len(arrays["means"]) == 0:
        raise ValueError("splats: there is no Gaussian, and a prim of USD needs one")
    values = _activated(arrays)

    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, float(meters_per_unit))
    label = Tf.MakeValidIdentifier(os.path.splitext(os.path.basename(name))[0])
    # Who refers to the file may give its default prim another transform, so the model is turned below that.
    root = UsdGeom.Xform.Define(stage, f"/{label}")
    stage.SetDefaultPrim(root.GetPrim())
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, f"/{label}/splats")
    field.AddRotateXOp().Set(180.0 if up_axis == "Y" else -90.0)
    field.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(values["positions"]))
    field.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(values["scales"]))
    # Quaternions of USD have their real part last in memory.
    field.CreateOrientationsAttr(Vt.QuatfArray.FromNumpy(np.roll(values["orientations"], -1, axis=1)))
    field.CreateOpacitiesAttr(Vt.FloatArray.FromNumpy(values["opacities"]))
    field.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(_extent(values)))
    sh = np.concatenate([arrays["sh0"], arrays["shN"]], axis=1)
    count = sh.shape[1]
    field.CreateRadianceSphericalHarmonicsDegreeAttr(int(count**0.5) - 1)
    coefficients = field.CreateRadianceSphericalHarmonicsCoefficientsAttr(
        Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(sh.reshape(-1, 3)))
    )
    primvar = UsdGeom.Primvar(coefficients)
    primvar.SetElementSize(count)
    primvar.SetInterpolation(UsdGeom.Tokens.vertex)
    if arrays["antialiased"]:
        warnings.warn(f"{name}: USD does not say that the model is antialiased", stacklevel=2)
    # Threads of this process may write to the same path.
    partial = f"{os.path.splitext(name)[0]}.{secrets.token_hex(8)}.part{extension}"
    try:
        try:
            stage.GetRootLayer().Export(partial)
        except Tf.ErrorException as error:
            raise OSError(f"{name}: cannot be written: {error}") from None
        os.replace(partial, name)
    except BaseException:
        with suppress(OSError):
            os.remove(partial)
        raise


def from_usd(path: PathLike, *, prim: Optional[str] = None) -> Splats:
    """Reads the ``ParticleField3DGaussianSplat`` prims of an OpenUSD file, with what it refers to, as one scene.

    ``prim``: only what is at this path or below. What is invisible, a guide or a proxy is left out, with a warning. Each
    prim is moved by its transform, and the stage, with y or z up, is turned to y down, as models of 3DGS are. A
    transform that mirrors or shears is refused. The unit stays that of the stage. Of values over time the earliest are
    read.

    Returns a dict of float32 arrays with gsplat's names; see :func:`gsvx.compress`. Opacities of 0 and 1, and scales of 0,
    become the nearest that have a logit or logarithm.

    Raises ImportError without usd-core, :class:`gsvx.Error` for a file that holds no such prim or a broken one, OSError
    for one that is not there.
    """
    Gf, Sdf, Tf, Usd, UsdGeom, UsdVol, Vt = _pxr()
    name = os.fspath(path)
    if not os.path.exists(name):
        raise FileNotFoundError(f"{name}: cannot be read: there is no such file")
    try:
        stage = Usd.Stage.Open(name)
    except Tf.ErrorException as error:
        raise _gsvx.Error(f"{name}: is no OpenUSD file that can be read: {error}") from None
    start = stage.GetPseudoRoot()
    if prim is not None:
        start = stage.GetPrimAtPath(prim) if Sdf.Path.IsValidPathString(prim) else None
        if not start:
            raise _gsvx.Error(f"{name}: has no prim {prim!r}")
    # Instances are read where they stand.
    every = Usd.PrimRange(start, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
    found = [p for p in every if p.IsA(UsdVol.ParticleField3DGaussianSplat)]
    shown = [p for p in found if _is_shown(UsdGeom.Imageable(p), UsdGeom.Tokens)]
    if not shown:
        which = "visible " if found else ""
        raise _gsvx.Error(f"{name}: holds no {which}{_TYPE} prim")
    if len(shown) < len(found):
        left_out = ", ".join(str(p.GetPath()) for p in found if p not in shown)
        warnings.warn(f"{name}: left out, since it is not shown: {left_out}", stacklevel=2)
    # From the stage's axes to y down.
    angle = 180.0 if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else 90.0
    turned = Gf.Matrix4d().SetRotate(Gf.Rotation(Gf.Vec3d(1, 0, 0), angle))
    cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
    parts = []
    for p in shown:
        matrix = np.array(cache.GetLocalToWorldTransform(p) * turned)
        try:
            part = _splats(UsdVol.ParticleField3DGaussianSplat(p), Usd.TimeCode.EarliestTime())
            parts.append(_moved(part, matrix))
        except ValueError as error:
            raise _gsvx.Error(f"{name}: {p.GetPath()}: {error}") from None
    degree = max(int((1 + part["shN"].shape[1]) ** 0.5) - 1 for part in parts)
    return parts[0] if len(parts) == 1 else joined(parts, degree)


def _pxr() -> Any:
    """The modules of usd-core that are used."""
    try:
        from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdVol, Vt  # type: ignore[import-untyped]
    except ImportError:
        raise ImportError("OpenUSD is not installed: pip install 'gsvx[usd]'") from None
    if not hasattr(UsdVol, _TYPE):
        raise ImportError(f"this OpenUSD has no {_TYPE}: pip install -U 'gsvx[usd]'")
    return Gf, Sdf, Tf, Usd, UsdGeom, UsdVol, Vt


def _activated(arrays: Splats) -> Splats:
    """What USD stores, from what training has."""
    quats = arrays["quats"].astype(np.float64)
    lengths = np.linalg.norm(quats, axis=1, keepdims=True)
    with np.errstate(all="ignore"):
        values = {
            "positions": arrays["means"],
            "scales": np.exp(arrays["scales"].astype(np.float64)),
            "orientations": quats / lengths,
            "opacities": 1.0 / (1.0 + np.exp(-arrays["opacities"].astype(np.float64))),
        }
        values = {name: np.ascontiguousarray(value, np.float32) for name, value in values.items()}
    for name, value in [*values.items(), ("SH coefficients", arrays["sh0"]), ("SH coefficients", arrays["shN"])]:
        bad = ~np.isfinite(value).reshape(len(value), -1).all(axis=1)
        if bad.any():
            raise ValueError(f"splats: {name} of Gaussian {int(bad.argmax())} are not finite in USD")
    return values


def _extent(values: Splats) -> npt.NDArray[np.float32]:
    """The box of all Gaussians."""
    axes = _matrices(values["orientations"]) * values["scales"][:, None, :]
    reach = _RADIUS * np.linalg.norm(axes, axis=2)
    centres = values["positions"].astype(np.float64)
    box = np.array([(centres - reach).min(axis=0), (centres + reach).max(axis=0)])
    return np.clip(box, -3e38, 3e38).astype(np.float32)


def _matrices(quats: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Rotation matrices of unit quaternions, w x y z; their columns are the Gaussians' axes."""
    w, x, y, z = quats.astype(np.float64).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _is_shown(prim: Any, tokens: Any) -> bool:
    visible = prim.ComputeVisibility() != tokens.invisible
    return visible and prim.ComputePurpose() in (tokens.default_, tokens.render)


def _splats(field: Any, time: Any) -> Splats:
    """The splats of a prim, in its own space."""

    def read(name: str, n: Optional[int], width: int) -> npt.NDArray[np.float32]:
        # The schema: float32 before its twin in half precision; more values than Gaussians are cut off.
        for attribute in (name, f"{name}h"):
            value = field.GetPrim().GetAttribute(attribute).Get(time)
            if value is not None and len(value):
                array = np.array(value, dtype=np.float32).reshape(-1, width)
                if n is not None and len(array) < n:
                    raise ValueError(f"{attribute} has {len(array)} values, {n} are needed")
                return array[:n]
        raise ValueError(f"{name} is missing")

    means = read("positions", None, 3)
    n = len(means)
    given = field.GetRadianceSphericalHarmonicsDegreeAttr().Get(time)
    degree = int(3 if given is None else given)
    if degree < 0:
        raise ValueError(f"SH degree is {degree}")
    name = "radiance:sphericalHarmonicsCoefficients"
    sh = read(name, n * (degree + 1) ** 2, 3).reshape(n, -1, 3)
    if degree > 3:
        warnings.warn(f"{field.GetPath()}: SH degree {degree} is cut to 3", stacklevel=3)
        sh = np.ascontiguousarray(sh[:, :16])
    scales = np.maximum(read("scales", n, 3).astype(np.float64), _LEAST_SCALE)
    opacities = np.clip(read("opacities", n, 1)[:, 0].astype(np.float64), _LEAST, _MOST)
    return {
        "means": means,
        "scales": np.log(scales).astype(np.float32),
        # Their real part is last in memory.
        "quats": np.ascontiguousarray(np.roll(read("orientations", n, 4), 1, axis=1)),
        "opacities": (np.log(opacities) - np.log1p(-opacities)).astype(np.float32),
        "sh0": sh[:, :1],
        "shN": sh[:, 1:],
    }


def _moved(splats: Splats, matrix: npt.NDArray[np.float64]) -> Splats:
    """Splats moved by a matrix whose last row is the offset, as USD has it."""
    if np.allclose(matrix, np.eye(4), rtol=0, atol=1e-7):
        return splats
    linear, offset = matrix[:3, :3].T, matrix[3, :3]
    scale = np.cbrt(np.linalg.det(linear))
    if not scale > 0 or not np.allclose(linear @ linear.T, scale**2 * np.eye(3), rtol=0, atol=1e-5 * scale**2):
        raise ValueError("its transform mirrors, shears or scales its axes differently, which Gaussians with SH cannot follow")
    turn = linear / scale
    out = dict(splats)
    out["means"] = (splats["means"] @ linear.T + offset).astype(np.float32)
    out["scales"] = (splats["scales"] + np.log(scale)).astype(np.float32)
    out["quats"] = _product(_quaternion(turn), splats["quats"].astype(np.float64)).astype(np.float32)
    sh = np.concatenate([splats["sh0"], splats["shN"]], axis=1)
    out["shN"] = np.einsum("ij,njc->nic", _sh_turn(turn, sh.shape[1]), sh)[:, 1:].astype(np.float32)
    return out


def _quaternion(turn: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The quaternion w x y z of a rotation: the eigenvector that its symmetric form of four dimensions keeps."""
    (a, b, c), (d, e, f), (g, h, i) = turn
    form = [
        [a + e + i, h - f, c - g, d - b],
        [h - f, a - e - i, b + d, c + g],
        [c - g, b + d, e - a - i, f + h],
        [d - b, c + g, f + h, i - a - e],
    ]
    vectors: npt.NDArray[np.float64] = np.linalg.eigh(np.array(form))[1]
    return vectors[:, 3]


def _product(left: npt.NDArray[np.float64], right: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    w, x, y, z = left
    return right @ np.array([[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])


def _sh_turn(turn: npt.NDArray[np.float64], count: int) -> npt.NDArray[np.float64]:
    """What makes coefficients of a turned Gaussian of its own: seen along d it has the colour that it had along d turned
    back."""
    golden = np.pi * (1 + 5**0.5) * np.arange(64)
    z = 1 - (2 * np.arange(64) + 1) / 64
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(golden), ring * np.sin(golden), z], axis=1)
    return np.linalg.pinv(_sh_basis(directions)[:, :count]) @ _sh_basis(directions @ turn)[:, :count]


def _sh_basis(directions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The SH functions of 3DGS at unit directions, except for their constant factors."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    one = np.ones_like(x)
    degree_2 = [x * y, -y * z, (2 * zz - xx - yy) / 12**0.5, -x * z, (xx - yy) / 2]
    degree_3 = [
        -y * (3 * xx - yy) * 10**0.5 / 4,
        x * y * z * 15**0.5,
        -y * (4 * zz - xx - yy) * 6**0.5 / 4,
        z * (2 * zz - 3 * xx - 3 * yy) / 2,
        -x * (4 * zz - xx - yy) * 6**0.5 / 4,
        z * (xx - yy) * 15**0.5 / 2,
        -x * (xx - 3 * yy) * 10**0.5 / 4,
    ]
    return np.stack([one, -y, z, -x, *degree_2, *degree_3], axis=1)
