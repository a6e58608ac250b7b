"""Models in files, renders, fine-tune."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import MODEL, ROOM, equal

import gsvx


def test_models_in_files(splats, small, tmp_path):
    ply = tmp_path / "m.ply"
    gsvx.write_model(ply, splats)
    assert equal(gsvx.read_model(ply), splats)
    gsvx.write_model(tmp_path / "m.spz", small)
    assert len(gsvx.read_model(tmp_path / "m.spz")["means"]) == 400
    gsvx.compress(tmp_path / "m.gsvx", small)
    assert equal(gsvx.read_model(tmp_path / "m.gsvx"), gsvx.decompress(tmp_path / "m.gsvx"))
    with pytest.raises(ValueError, match="to write a stream, use compress"):
        gsvx.write_model(tmp_path / "m2.gsvx", small)
    with pytest.raises(ValueError, match="its extension names no format"):
        gsvx.write_model(tmp_path / "m.txt", small)
    with pytest.raises(FileNotFoundError, match="nothing.ply"):
        gsvx.read_model(tmp_path / "nothing.ply")
    with pytest.raises(gsvx.Error, match="is a folder"):
        gsvx.read_model(tmp_path)
    (tmp_path / "bad.ply").write_bytes(MODEL.read_bytes()[:5000])
    with pytest.raises(gsvx.Error, match="bad.ply.*promises"):
        gsvx.read_model(tmp_path / "bad.ply")


def test_invalid_gaussians_of_a_file(small, tmp_path):
    small["means"] = small["means"].copy()
    small["means"][3] = np.nan
    gsvx.write_model(tmp_path / "nan.ply", small)
    with pytest.raises(gsvx.Error, match="nan.ply.*pass drop_invalid=True"):
        gsvx.read_model(tmp_path / "nan.ply")
    with pytest.warns(UserWarning, match="1 invalid Gaussian is left out, of 400"):
        assert len(gsvx.read_model(tmp_path / "nan.ply", drop_invalid=True)["means"]) == 399


def test_cameras_have_gsplats_conventions():
    cameras = gsvx.read_cameras(ROOM)
    train, test = gsvx.read_cameras(ROOM, "train"), gsvx.read_cameras(ROOM, "test")
    assert len(train) + len(test) == len(cameras) == 32
    assert test.names[:2] == [cameras.names[0], cameras.names[8]]
    assert cameras.viewmats.shape == (32, 4, 4) and cameras.Ks.shape == (32, 3, 3)
    rotations = cameras.viewmats[:, :3, :3]
    assert np.allclose(rotations @ rotations.transpose(0, 2, 1), np.eye(3), atol=1e-6)
    assert (cameras.sizes == [240, 160]).all()
    with pytest.raises(ValueError, match="split"):
        gsvx.read_cameras(ROOM, "some")
    for change, said in [
        (dict(viewmats=np.eye(4)), "viewmats: shape"),
        (dict(Ks=cameras.Ks + [[0, 1, 0], [0, 0, 0], [0, 0, 0]]), "skew"),
        (dict(viewmats=cameras.viewmats.transpose(0, 2, 1)), "the last row"),
        (dict(names=["one"]), "names: 1 of them for 32 cameras"),
        (dict(sizes=[[1, 2, 3]]), "sizes: shape"),
    ]:
        given = dict(viewmats=cameras.viewmats, Ks=cameras.Ks, sizes=cameras.sizes)
        with pytest.raises(ValueError, match=said):
            gsvx.Cameras(**{**given, **change})
    twisted = gsvx.Cameras(2 * cameras.viewmats - np.diag([0, 0, 0, 1]), cameras.Ks, cameras.sizes)
    with pytest.raises(gsvx.Error, match="pose is not a rotation"):
        gsvx.render(MODEL, twisted)


def test_render_projects_as_gsplat_does():
    """A Gaussian falls where K (R p + t) is, and has the colour that its SH say."""
    viewmat = np.eye(4)
    viewmat[:3, 3] = [0.1, -0.2, 3]
    intrinsics = np.array([[50.0, 0, 32], [0, 60, 24], [0, 0, 1]])
    splats = dict(
        means=[[0.5, 0.4, 1.0]],
        scales=[[-1.5, -1.5, -1.5]],
        quats=[[1.0, 0, 0, 0]],
        opacities=[6.0],
        sh0=[[[0.5 / 0.28209479, -0.5 / 0.28209479, 0]]],
    )
    (image,) = gsvx.render(splats, (viewmat[None], intrinsics[None], [64, 48]))
    assert image.shape == (48, 64, 3) and image.dtype == np.float32
    x, y, z = viewmat[:3, :3] @ splats["means"][0] + viewmat[:3, 3]
    where = np.array([50 * x / z + 32, 60 * y / z + 24])
    weight = image[..., 0] / image[..., 0].sum()
    rows, columns = np.mgrid[:48, :64] + 0.5
    assert np.allclose([(weight * columns).sum(), (weight * rows).sum()], where, atol=0.05)
    peak = image[int(where[1]), int(where[0])]
    assert peak[0] > 0.9 and peak[1] < 0.01 and 0.4 < peak[2] < 0.55
    (blue,) = gsvx.render(splats, (viewmat[None], intrinsics[None], [64, 48]), background=[0, 0, 1])
    assert blue[0, 0].tolist() == [0, 0, 1]
    with pytest.raises(ValueError, match="background"):
        gsvx.render(splats, (viewmat[None], intrinsics[None], [64, 48]), background=[2, 0, 0])


def test_comparison(splats):
    cameras = gsvx.read_cameras(ROOM, "test")
    same = gsvx.compare(splats, splats, cameras)
    assert same.psnr == np.inf and same.ssim == 1
    worse = gsvx.decompress_bytes(gsvx.compress_to_bytes(splats, quality=20))
    found = gsvx.compare(MODEL, worse, cameras)
    assert found.worst.psnr == min(view.psnr for view in found.views) < found.psnr < 36
    images = [gsvx.render(model, cameras[:1])[0].clip(0, 1) for model in (splats, worse)]
    error = np.mean(np.square(images[0].astype(float) - images[1]))
    assert np.isclose(found.views[0].psnr, -10 * np.log10(error))


def test_tune_takes_photos_as_arrays(splats, tmp_path):
    splats = {name: array[::5] for name, array in splats.items()}
    cameras = gsvx.read_cameras(ROOM, "train")[::4]
    photos = [image.clip(0, 1) for image in gsvx.render(splats, cameras)]
    given = dict(effort="quick", quality=30)
    report = gsvx.tune(tmp_path / "a.gsvx", splats, cameras, photos, **given)
    assert not report.distilled and report.input_psnr > 58  # Photos have 8 bits.
    eight = [(255 * image + 0.5).astype(np.uint8) for image in photos]
    floats = [image.astype(np.float32) / 255 for image in eight]
    gsvx.tune(tmp_path / "a.gsvx", splats, cameras, floats, **given)
    gsvx.tune(tmp_path / "b.gsvx", splats, cameras, eight, **given)
    assert (tmp_path / "a.gsvx").read_bytes() == (tmp_path / "b.gsvx").read_bytes()
    distilled = gsvx.tune(tmp_path / "c.gsvx", splats, cameras, distil=True, **given)
    assert distilled.distilled and distilled.elsewhere_psnr > 20
    assert len(gsvx.decompress(tmp_path / "a.gsvx")["means"]) < len(splats["means"])


def test_a_tuned_stream_that_cannot_be_written_is_an_error(splats):
    class Full:
        def write(self, data):
            raise OSError("no space")

    splats = {name: array[::20] for name, array in splats.items()}
    cameras = gsvx.read_cameras(ROOM, "train")[::8]
    with pytest.raises(OSError, match="no space"):
        gsvx.tune(Full(), splats, cameras, distil=True, effort="quick", quality=30)


def test_wrong_use_of_tune(splats, tmp_path):
    out = tmp_path / "x.gsvx"
    cameras = gsvx.read_cameras(ROOM, "train")[:3]
    for given, said in [
        (dict(quality=40, target_bytes=1), "only one of them"),
        (dict(quality=40, qualities=[40]), "only one of them"),
        (dict(qualities=[]), "at least one expected"),
        (dict(qualities=["many"]), "a number expected"),
        (dict(effort="much"), "effort: use quick"),
        (dict(photos=[np.zeros((4, 4))] * 3), "height, width, 3"),
        (dict(photos=[np.zeros((160, 240, 3), np.uint8)]), "1 of them for 3 cameras"),
    ]:
        with pytest.raises(ValueError, match=said):
            gsvx.tune(out, splats, cameras, **given)
    black = [np.zeros((160, 240, 3), np.uint8)] * 3
    with pytest.raises(gsvx.Error, match="photos are grey"):
        gsvx.tune(out, splats, cameras, black)
    red = [np.zeros((160, 240, 3), np.uint8) for _ in range(3)]
    for photo in red:
        photo[:, :120, 0] = 255
    with pytest.raises(gsvx.Error, match="do not show this model"):
        gsvx.tune(out, splats, cameras, red)
    with pytest.raises(gsvx.Error, match="aspect ratio"):
        gsvx.tune(out, splats, cameras, [np.zeros((100, 100, 3), np.uint8)] * 3)
    with pytest.raises(gsvx.Error, match="below what a tune of this model reaches"):
        gsvx.tune(out, splats, ROOM, effort="quick", target_bytes=100)
    assert not out.exists()


def test_cameras_around_a_model_are_those_of_the_command(splats, command, tmp_path):
    cameras = gsvx.orbit(splats, 3, size=(96, 64), fov=50, up=(0, 0, 2))
    assert len(cameras) == 3 and cameras.names[2] == "orbit-0002"
    gsvx.compress(tmp_path / "s.gsvx", splats, quality=20)
    turn = ["--orbit", 3, "--size", "96x64", "--fov", 50, "--up", "z"]
    want = json.loads(command("compare", MODEL, tmp_path / "s.gsvx", *turn, "--json"))["views"]
    got = gsvx.compare(splats, tmp_path / "s.gsvx", cameras).views
    assert [view.name for view in got] == [view["name"] for view in want]
    for score in ["psnr", "ssim", "ssimulacra2"]:
        got_scores = [getattr(view, score) for view in got]
        assert np.allclose(got_scores, [view[score] for view in want], rtol=1e-6)
    # All on one circle.
    eyes = [-np.asarray(m[:3, :3]).T @ m[:3, 3] for m in gsvx.orbit(splats, 8, full_circle=True).viewmats]
    far = np.linalg.norm(np.asarray(eyes) - np.mean(eyes, axis=0), axis=1)
    assert np.ptp(far) < 1e-6 * far.max()
    for wrong in [dict(count=0), dict(count=1, fov=0), dict(count=1, up=(0, 0, 0)), dict(count=1, radius=-1)]:
        with pytest.raises(ValueError):
            gsvx.orbit(splats, **wrong)
    with pytest.raises(gsvx.Error, match="no Gaussian to look at"):
        gsvx.orbit({name: array[:0] for name, array in splats.items()}, 1)
