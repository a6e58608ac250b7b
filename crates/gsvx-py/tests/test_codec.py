"""compress and decompress."""

from __future__ import annotations

import io
import shutil
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import MODEL, ROOM, equal

import gsvx


def test_round_trip_has_gsplats_names_shapes_and_types(splats, tmp_path):
    path = tmp_path / "room.gsvx"
    report = gsvx.compress(path, splats)
    assert report.bytes == path.stat().st_size
    assert list(tmp_path.iterdir()) == [path], "nothing else stays"
    back = gsvx.decompress(path)
    n = report.gaussians
    shapes = {name: array.shape for name, array in back.items()}
    assert shapes == {
        "means": (n, 3),
        "scales": (n, 3),
        "quats": (n, 4),
        "opacities": (n,),
        "sh0": (n, 1, 3),
        "shN": (n, 15, 3),
    }
    assert all(array.dtype == np.float32 for array in back.values())
    assert equal(back, gsvx.decompress_bytes(path.read_bytes()))
    assert equal(back, gsvx.decompress(io.BytesIO(path.read_bytes())))
    score = gsvx.compare(splats, back, gsvx.read_cameras(ROOM, "test"))
    assert score.psnr > 36 and score.ssim > 0.97


def test_lossless_keeps_every_bit_and_rows_find_it(splats):
    out = io.BytesIO()
    splats["opacities"] = splats["opacities"].copy()
    splats["opacities"][5] = np.nan
    report = gsvx.compress(out, splats, lossless=True, rows=True)
    back = gsvx.decompress_bytes(out.getvalue())
    assert sorted(report.rows) == list(range(len(splats["means"])))
    assert equal({name: array[report.rows] for name, array in back.items()}, splats)


def test_rows_tell_what_became_of_each_gaussian(splats):
    n = len(splats["means"])
    splats = {name: array.copy() for name, array in splats.items()}
    splats["scales"][7] = np.inf
    splats["means"][11] = [1e7, 0, 0]
    out = io.BytesIO()
    options = dict(prune=0.2, drop_invalid=True, quality=40, rows=True)
    report = gsvx.compress(out, splats, **options)
    back = gsvx.decompress_bytes(out.getvalue())
    rows = report.rows
    assert rows.shape == (n,) and rows.dtype == np.int64 and rows[7] == -1
    assert report.invalid == 1 and report.transparent == 4
    assert report.pruned == (n - 1 - report.transparent) // 5
    assert (rows < 0).sum() == report.invalid + report.transparent + report.pruned
    assert set(rows[rows >= 0]) == set(range(report.gaussians)), "every row has a Gaussian"
    if report.outliers and rows[11] >= 0:
        assert (back["means"][rows[11]] == splats["means"][11]).all()
    kept = np.flatnonzero((rows >= 0) & (np.arange(n) != 11))
    moved = np.abs(back["means"][rows[kept]] - splats["means"][kept]).max()
    assert moved < 0.5, "rows lead to Gaussians at the same place"
    plain = gsvx.compress_to_bytes(splats, **{**options, "rows": False})
    assert plain == out.getvalue()
    assert gsvx.compress(io.BytesIO(), MODEL).rows is None


def test_errors_keep_their_bounds(small):
    out = io.BytesIO()
    bounds = dict(mean=0.1, opacity=0.02, shape=0.05, sh=0.01)
    report = gsvx.compress(out, small, max_error=bounds, rows=True)
    assert report.gaussians == 400 and all(report.max_error[name] <= bounds[name] for name in bounds)
    back = {name: a[report.rows] for name, a in gsvx.decompress_bytes(out.getvalue()).items()}
    assert np.abs(back["shN"] - small["shN"]).max() <= 0.01
    longest = np.exp(small["scales"].max(axis=1))
    assert (np.linalg.norm(back["means"] - small["means"], axis=1) <= 0.1001 * longest).all()


class Tensor:
    """As a tensor of torch that lies on a GPU and requires gradients."""

    def __init__(self, array, steps=()):
        self.array, self.steps = array, steps
        self.shape = array.shape

    def detach(self):
        return Tensor(self.array, (*self.steps, "detach"))

    def cpu(self):
        return Tensor(self.array, (*self.steps, "cpu"))

    def __array__(self, dtype=None, copy=None):
        assert self.steps == ("detach", "cpu"), "numpy would refuse it"
        return self.array


class OnlyDlpack:
    def __init__(self, array):
        self.array = array

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_any_arrays_give_the_same_bytes(small):
    small = {name: np.ascontiguousarray(array) for name, array in small.items()}
    want = gsvx.compress_to_bytes(small)
    unaligned = np.frombuffer(b"x" + small["means"].tobytes(), np.uint8)[1:].view(np.float32)
    for change in [
        lambda a: a.astype(np.float64),
        lambda a: a.astype(">f4"),
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: Tensor(a),
        lambda a: a.tolist(),
        lambda a: unaligned.reshape(a.shape) if a is small["means"] else a,
    ]:
        assert gsvx.compress_to_bytes({k: change(a) for k, a in small.items()}) == want
    if hasattr(np, "from_dlpack"):
        given = {name: OnlyDlpack(array) for name, array in small.items()}
        assert gsvx.compress_to_bytes(given) == want


def test_inputs_are_not_changed(splats):
    before = {name: array.copy() for name, array in splats.items()}
    for array in splats.values():
        array.flags.writeable = False
    gsvx.compress_to_bytes(splats, quality=30, prune=0.5)
    gsvx.render(splats, gsvx.read_cameras(ROOM, "test")[:1])
    assert equal(splats, before)


@pytest.mark.parametrize("k", [0, 3, 8, 15])
def test_every_sh_degree(small, k):
    small["shN"] = small["shN"][:, :k]
    assert gsvx.decompress_bytes(gsvx.compress_to_bytes(small))["shN"].shape[1] == k
    stream = gsvx.compress_to_bytes(small, lossless=True)
    assert gsvx.decompress_bytes(stream, max_sh_degree=0)["shN"].shape[1] == 0


def test_no_and_one_gaussian(small):
    for n in (0, 1):
        few = {name: array[:n] for name, array in small.items()}
        for options in ({}, {"lossless": True}):
            back = gsvx.decompress_bytes(gsvx.compress_to_bytes(few, **options))
            assert len(back["means"]) == n


def test_a_target_is_met_or_missed_with_a_warning(splats):
    out = io.BytesIO()
    report = gsvx.compress(out, splats, target_bytes=60_000)
    assert 59_000 < report.bytes <= 60_000 and report.missed is None
    with pytest.warns(UserWarning, match="below the smallest stream of this scene"):
        report = gsvx.compress(out, splats, target_bytes=100)
    assert report.missed and report.bytes > 100
    report = gsvx.compress(out, splats, cameras=ROOM, target_psnr=33)
    assert 33 <= report.psnr < 33.5 and report.ssimulacra2 is None
    report = gsvx.compress(out, splats, cameras=ROOM, target_ssimulacra2=60)
    assert 60 <= report.ssimulacra2 < 61 and report.psnr is None


def test_cameras_as_arrays_are_those_of_the_folder(splats):
    folder = gsvx.compress_to_bytes(splats, cameras=str(ROOM), drop_unseen=True)
    cameras = gsvx.read_cameras(ROOM, "train")
    assert gsvx.compress_to_bytes(splats, cameras=cameras, drop_unseen=True) == folder
    arrays = (cameras.viewmats, cameras.Ks, cameras.sizes)
    assert gsvx.compress_to_bytes(splats, cameras=arrays, drop_unseen=True) == folder


def test_lenses_are_read_and_named_where_renders_do_not_show_them(splats, tmp_path):
    shutil.copytree(ROOM / "sparse", tmp_path / "sparse")
    cameras = tmp_path / "sparse/0/cameras.txt"
    bent = cameras.read_text().strip().replace(" PINHOLE ", " OPENCV ") + " 0.1 0 0.01 0"
    cameras.write_text(bent)
    assert gsvx.read_cameras(tmp_path).lenses[0] == ("OPENCV", [0.1, 0.0, 0.01, 0.0])
    with pytest.warns(UserWarning, match=r"lens distortion \(OPENCV\)"):
        gsvx.compare(splats, splats, tmp_path)
    wide = cameras.read_text().replace(" OPENCV ", " EQUIRECTANGULAR ").rsplit(" ", 6)[0]
    cameras.write_text(wide)
    with pytest.raises(gsvx.Error, match="a panorama"):
        gsvx.render(splats, gsvx.read_cameras(tmp_path)[:1])


def test_cameras_of_another_scene_are_an_error_or_a_warning(splats):
    cameras = gsvx.read_cameras(ROOM, "train")
    away = cameras.viewmats.copy()
    away[:, :3, 3] += [0, 0, -1000]
    with pytest.raises(gsvx.Error, match="see nothing of the model; are they its own"):
        gsvx.compress_to_bytes(splats, cameras=(away, cameras.Ks, cameras.sizes))
    with pytest.warns(UserWarning, match="of the model's opacity; are they its own"):
        gsvx.compress_to_bytes(splats, cameras=(cameras[:1].viewmats, cameras[:1].Ks, [24, 16]))


@pytest.mark.parametrize(
    "options, said",
    [
        (dict(quality=101), "quality is 101, must be between 0 and 100"),
        (dict(quality=50, target_bytes=10), "only one of them"),
        (dict(preset="huge"), "preset: use tiny, web, high, archive"),
        (dict(target_psnr=30), "needs cameras"),
        (dict(target_ssimulacra2=70), "needs cameras"),
        (dict(drop_unseen=True), "needs cameras"),
        (dict(lossless=True, prune=0.1), "lossless: cannot be used with prune"),
        (dict(max_error=0), "bound on the mean is 0"),
        (dict(max_error={"mean": 1}), "one for each of mean, opacity, shape, sh"),
        (dict(max_error=0.1, web=True), "max_error: cannot be used with web"),
        (dict(prune=1.0), "prune is 1, must be from 0 to below 1"),
        (dict(max_sh_degree=4), "must be 0 to 3"),
        (dict(depth=22), "depth is 22"),
        (dict(j_low=3), "j_low: needs depth"),
        (dict(cameras=7), "cameras: a path"),
    ],
)
def test_wrong_use_is_a_value_error(small, options, said):
    with pytest.raises(ValueError, match=said):
        gsvx.compress_to_bytes(small, **options)


def test_wrong_arrays_are_named(small):
    for change, said in [
        (dict(means=small["means"][:, :2]), r"means: shape \(N, 3\) with N = 400 expected"),
        (dict(scales=small["scales"][:7]), "scales: shape"),
        (dict(opacities=small["means"]), r"opacities: shape \(N,\)"),
        (dict(shN=small["shN"][:, :4]), "K of 0, 3, 8 or 15"),
        (dict(features=small["means"]), "features cannot be kept"),
        (dict(quats="abc"), "quats: no array of numbers"),
    ]:
        with pytest.raises(ValueError, match=said):
            gsvx.compress_to_bytes({**small, **change})
    with pytest.raises(ValueError, match="sh0 missing"):
        gsvx.compress_to_bytes({k: v for k, v in small.items() if k != "sh0"})
    small["means"] = small["means"].copy()
    small["means"][3, 1] = np.nan
    with pytest.raises(gsvx.Error, match="pass drop_invalid=True to leave them out"):
        gsvx.compress_to_bytes(small)
    assert len(gsvx.decompress_bytes(gsvx.compress_to_bytes(small, drop_invalid=True))["means"])


def test_files_that_are_not_there_are_os_errors(small, tmp_path):
    with pytest.raises(FileNotFoundError):
        gsvx.decompress(tmp_path / "nothing.gsvx")
    with pytest.raises(FileNotFoundError):
        gsvx.compress(tmp_path / "no" / "folder.gsvx", small)
    with pytest.raises(ValueError, match="an object with write"):
        gsvx.compress(7, small)


def test_a_failed_write_leaves_the_old_file(small, tmp_path):
    path = tmp_path / "old.gsvx"
    path.write_bytes(b"old")
    small["means"] = np.full_like(small["means"], np.nan)
    with pytest.raises(gsvx.Error):
        gsvx.compress(path, small)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_threads_can_write_to_one_path(small, tmp_path):
    path = tmp_path / "a.gsvx"
    models = [{name: array[: 50 * (k + 1)] for name, array in small.items()} for k in range(4)]
    streams = [gsvx.compress_to_bytes(model) for model in models]
    for _ in range(30):
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda model: gsvx.compress(path, model), models))
        assert path.read_bytes() in streams
        assert list(tmp_path.iterdir()) == [path], "nothing else stays"


class Reluctant(io.RawIOBase):
    """Takes few bytes at a time, and no more than it holds."""

    def __init__(self, most: int):
        self.data, self.most = b"", most

    def writable(self) -> bool:
        return True

    def write(self, data) -> int:
        taken = bytes(data)[: min(1000, self.most - len(self.data))]
        self.data += taken
        return len(taken)


def test_a_file_may_take_fewer_bytes_than_it_is_given(small):
    stream = gsvx.compress_to_bytes(small)
    file = Reluctant(1 << 20)
    gsvx.compress(file, small)
    assert file.data == stream
    with pytest.raises(OSError, match="takes no more bytes"):
        gsvx.compress(Reluctant(len(stream) - 1), small)
    told = []

    class Silent:
        def write(self, data):
            told.append(bytes(data))

    gsvx.compress(Silent(), small)
    assert told == [stream]


@pytest.mark.parametrize(
    "wrong",
    [
        lambda a: a.astype(np.complex64),
        lambda a: a.astype("datetime64[s]"),
        lambda a: a.astype("timedelta64[s]"),
        lambda a: a.astype("U8"),
        lambda a: a.astype(object),
        lambda a: a.view([("x", np.float32)]),
    ],
)
def test_arrays_of_something_else_than_numbers_are_refused(small, wrong):
    for name in ("opacities", "shN"):
        with pytest.raises(ValueError, match=f"{name}: no array of numbers: its type is"):
            gsvx.compress_to_bytes({**small, name: wrong(small[name])})
    kept = {name: array.astype(np.float64) for name, array in small.items()}
    assert gsvx.compress_to_bytes(kept) == gsvx.compress_to_bytes(small)


def test_values_of_a_wrong_type_are_named_as_the_caller_names_them(small):
    for options in (
        {"quality": "high"},
        {"target_bytes": 1.5},
        {"max_error": "small"},
        {"max_sh_degree": "all"},
        {"prune": None},
        {"depth": "x"},
    ):
        with pytest.raises((TypeError, ValueError)) as raised:
            gsvx.compress_to_bytes(small, **options)
        said, [name] = str(raised.value), options
        assert said.startswith(f"{name}: "), said


def test_threads_do_not_change_the_bytes(splats):
    try:
        streams = []
        for threads in (1, 3, 0):
            gsvx.set_threads(threads)
            streams.append(gsvx.compress_to_bytes(splats, lod=True))
    finally:
        gsvx.set_threads(0)
    assert streams[0] == streams[1] == streams[2]


def test_progress_is_told_and_its_exceptions_end_the_work(splats):
    told = []
    gsvx.compress_to_bytes(splats, cameras=ROOM, quality=30, progress=told.append)
    assert {p.stage for p in told} == {"importance", "encode"}
    assert told[-1].values["quality"] == 30 and told[0].total == 28

    def stop(_):
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        gsvx.compress_to_bytes(splats, cameras=ROOM, progress=stop)


def test_damage_is_named_and_the_rest_can_be_had(splats, tmp_path):
    path = tmp_path / "cut.gsvx"
    stream = gsvx.compress_to_bytes(splats, web=True)
    path.write_bytes(stream[:-100])
    with pytest.raises(gsvx.Error, match="cut.gsvx: .*pass salvage=True"):
        gsvx.decompress(path)
    with pytest.warns(UserWarning, match="truncated"):
        part = gsvx.decompress(path, salvage=True)
    assert len(part["means"]) > 5000 and not part["shN"][:, 8:].any()
    with pytest.raises(gsvx.Error, match="pass max_gaussians="):
        gsvx.decompress_bytes(stream, max_gaussians=10)
    with pytest.raises(gsvx.Error, match="not a gsvx stream"):
        gsvx.decompress(MODEL)
    with pytest.raises(ValueError, match="bytes expected"):
        gsvx.decompress_bytes("text")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert gsvx.decompress_bytes(stream, max_sh_degree=1)["shN"].shape[1] == 3


def test_an_estimate_of_the_loss(splats):
    import io

    none = gsvx.compress(io.BytesIO(), splats)
    assert none.estimate is None
    estimates = []
    for options in [dict(quality=20), dict(quality=80), dict(quality=80, cameras=ROOM)]:
        out = io.BytesIO()
        estimates.append(gsvx.compress(out, splats, estimate=True, **options).estimate)
        assert out.getvalue() == gsvx.compress_to_bytes(splats, **options)
    low, high, seen = estimates
    assert low.views == high.views == 4 < seen.views <= 8
    assert 10 < low.psnr < high.psnr < 99 and low.ssim < high.ssim <= 1
    assert low.ssimulacra2 < 30 and 75 < high.ssimulacra2 < 100
    assert low.meaning != high.meaning
