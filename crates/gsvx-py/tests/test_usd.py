"""OpenUSD: scenes as prims, there and back, as its own checkers have them."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from conftest import ROOM, say_skipped

import gsvx
from gsvx import _usd

try:
    from pxr import Gf, Usd, UsdGeom, UsdValidation, UsdVol, Vt
except ImportError:
    say_skipped("usd-core is not installed: pip install 'gsvx[usd]'")


def same_in_usd(a, b):
    """The values that USD stores agree to 1e-6, and what is stored as it is agrees bit for bit."""
    for name in ("means", "sh0", "shN"):
        assert np.array_equal(a[name], b[name]), name
    a, b = _usd._activated({**a, "antialiased": False}), _usd._activated({**b, "antialiased": False})
    for name in a:
        assert np.allclose(a[name], b[name], rtol=1e-6, atol=1e-7), name


@pytest.mark.parametrize("extension", [".usda", ".usdc", ".usd"])
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
def test_a_scene_comes_back_to_a_millionth(splats, tmp_path, extension, up_axis):
    path = tmp_path / f"my room{extension}"
    gsvx.to_usd(splats, path, up_axis=up_axis, meters_per_unit=0.5)
    same_in_usd(splats, gsvx.from_usd(path))
    assert path.read_bytes().startswith(b"#usda" if extension == ".usda" else b"PXR-USDC")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_the_prim_is_as_the_schema_and_its_checkers_ask(small, tmp_path):
    path = tmp_path / "small.usda"
    gsvx.to_usd(small, path)
    stage = Usd.Stage.Open(str(path))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not errors, [error.GetMessage() for error in errors]
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    (prim,) = stage.GetDefaultPrim().GetChildren()
    assert prim.GetTypeName() == "ParticleField3DGaussianSplat"
    get = lambda name: np.array(prim.GetAttribute(name).Get())  # noqa: E731
    assert np.allclose(get("scales"), np.exp(small["scales"]))
    assert np.allclose(get("opacities"), 1 / (1 + np.exp(-small["opacities"])))
    first = prim.GetAttribute("orientations").Get()[0]
    quat = small["quats"][0] / np.linalg.norm(small["quats"][0])
    assert np.allclose([first.GetReal(), *first.GetImaginary()], quat, atol=1e-6)
    degree = prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get()
    assert len(get("radiance:sphericalHarmonicsCoefficients")) == 400 * (degree + 1) ** 2
    low, high = get("extent")
    assert (low < small["means"].min(axis=0)).all() and (high > small["means"].max(axis=0)).all()
    # Up in the stage is minus y of the model.
    world = UsdGeom.XformCache().GetLocalToWorldTransform(prim)
    assert np.allclose(world.Transform(Gf.Vec3d(1, 2, 3)), (1, -2, -3))


def test_streams_and_models_are_written_by_name(small, tmp_path):
    gsvx.compress(tmp_path / "a.gsvx", small)
    gsvx.to_usd(tmp_path / "a.gsvx", tmp_path / "a.usdc")
    same_in_usd(gsvx.decompress(tmp_path / "a.gsvx"), gsvx.from_usd(tmp_path / "a.usdc"))


def test_a_turned_prim_looks_as_before_from_where_it_is_turned_to(splats, tmp_path):
    # The room has Gaussians of equal depth, whose order the least rounding changes.
    noise = np.random.default_rng(3).normal(scale=0.003, size=splats["means"].shape)
    splats["means"] = splats["means"] + noise.astype(np.float32)
    gsvx.to_usd(splats, tmp_path / "room.usdc")
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    for name in "ab":
        prim = UsdGeom.Xform.Define(stage, f"/{name}")
        prim.GetPrim().GetReferences().AddReference("./room.usdc")
    axis = Gf.Rotation(Gf.Vec3d(1, 2, 3), 77)
    matrix = Gf.Matrix4d().SetRotate(axis) * Gf.Matrix4d().SetTranslate((4, 5, 6))
    UsdGeom.Xform(stage.GetPrimAtPath("/a")).MakeMatrixXform().Set(matrix)
    UsdGeom.Imageable(stage.GetPrimAtPath("/b")).MakeInvisible()
    stage.Save()
    with pytest.warns(UserWarning, match="not shown: /b/splats"):
        moved = gsvx.from_usd(tmp_path / "shot.usda")
    # In the axes of the model: y down.
    flip = np.diag([1.0, -1, -1, 1])
    move = flip @ np.array(matrix).T @ flip
    cameras = gsvx.read_cameras(ROOM, "test")
    poses = move @ np.linalg.inv(cameras.viewmats)
    turned = gsvx.Cameras(viewmats=np.linalg.inv(poses), Ks=cameras.Ks, sizes=cameras.sizes)
    for a, b in zip(gsvx.render(splats, cameras), gsvx.render(moved, turned)):
        assert np.abs(a - b).mean() < 2e-4

    stage.GetPrimAtPath("/b").GetAttribute("visibility").Clear()
    UsdGeom.Xform(stage.GetPrimAtPath("/a")).AddScaleOp().Set(Gf.Vec3f(2.0))
    stage.Save()
    both = gsvx.from_usd(tmp_path / "shot.usda")
    n = len(splats["means"])
    assert len(both["means"]) == 2 * n
    assert np.allclose(both["scales"][:n], splats["scales"] + np.log(2), atol=1e-5)
    same_in_usd(splats, gsvx.from_usd(tmp_path / "shot.usda", prim="/b"))


def test_files_of_others_are_read(small, tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "half.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, "/a")
    field.CreatePositionshAttr(Vt.Vec3hArray([Gf.Vec3h(1, 2, 3), Gf.Vec3h(4, 5, 6)]))
    field.CreateScaleshAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1), Gf.Vec3h(0, 1, 2)]))
    field.CreateOrientationshAttr(Vt.QuathArray([Gf.Quath(1), Gf.Quath(1)]))
    field.CreateOpacitiesAttr(Vt.FloatArray([0.0, 1.0, 0.5]))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(0)
    field.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray(2, Gf.Vec3f(0.5)))
    stage.Save()
    read = gsvx.from_usd(tmp_path / "half.usda")
    assert np.allclose(read["means"], [[1, -2, -3], [4, -5, -6]])
    assert all(np.isfinite(array).all() for array in read.values())
    assert read["shN"].shape == (2, 0, 3)
    gsvx.compress(tmp_path / "a.gsvx", read)

    field.CreateOrientationshAttr(Vt.QuathArray([Gf.Quath(1)]))
    stage.Save()
    with pytest.raises(gsvx.Error, match="half.usda: /a: orientationsh has 1 values, 2 are needed"):
        gsvx.from_usd(tmp_path / "half.usda")


def test_what_cannot_be_is_said_in_one_line(small, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="name it .usd"):
        gsvx.to_usd(small, tmp_path / "a.usdz")
    with pytest.raises(ValueError, match="up_axis"):
        gsvx.to_usd(small, tmp_path / "a.usd", up_axis="X")
    with pytest.raises(ValueError, match="meters_per_unit"):
        gsvx.to_usd(small, tmp_path / "a.usd", meters_per_unit=float("nan"))
    with pytest.raises(ValueError, match="no Gaussian"):
        gsvx.to_usd({name: array[:0] for name, array in small.items()}, tmp_path / "a.usd")
    with pytest.raises(ValueError, match="scales of Gaussian 7 are not finite"):
        gsvx.to_usd({**small, "scales": np.where(np.arange(400)[:, None] == 7, 1e4, small["scales"])}, tmp_path / "a.usd")
    with pytest.warns(UserWarning, match="antialiased"):
        gsvx.to_usd({**small, "antialiased": True}, tmp_path / "b.usd")
    with pytest.raises(FileNotFoundError, match="nothing.usd"):
        gsvx.from_usd(tmp_path / "nothing.usd")
    (tmp_path / "bad.usd").write_bytes(b"no stage" * 10)
    with pytest.raises(gsvx.Error, match="bad.usd: is no OpenUSD file"):
        gsvx.from_usd(tmp_path / "bad.usd")
    stage = Usd.Stage.CreateNew(str(tmp_path / "cube.usda"))
    UsdGeom.Cube.Define(stage, "/cube")
    stage.Save()
    with pytest.raises(gsvx.Error, match="cube.usda: holds no ParticleField3DGaussianSplat prim"):
        gsvx.from_usd(tmp_path / "cube.usda")
    with pytest.raises(gsvx.Error, match="has no prim '/ball'"):
        gsvx.from_usd(tmp_path / "cube.usda", prim="/ball")
    gsvx.to_usd(small, tmp_path / "c.usda")
    mirrored = Usd.Stage.Open(str(tmp_path / "c.usda"))
    UsdGeom.Xform(mirrored.GetDefaultPrim()).AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    mirrored.Save()
    with pytest.raises(gsvx.Error, match="c.usda: /c/splats: its transform mirrors"):
        gsvx.from_usd(tmp_path / "c.usda")
    assert not (tmp_path / "a.usd").exists()
    monkeypatch.setitem(sys.modules, "pxr", None)
    for call in (lambda: gsvx.from_usd("c.usda"), lambda: gsvx.to_usd(small, "c.usda")):
        with pytest.raises(ImportError, match=r"pip install 'gsvx\[usd\]'"):
            call()
