"""Streams and models are those of the command."""

from __future__ import annotations

import pytest
from conftest import MODEL, ROOM, equal

import gsvx

CASES = [
    ({}, []),
    (dict(quality=35.5), ["--quality", 35.5]),
    *((dict(preset=name), ["--preset", name]) for name in gsvx.PRESETS),
    (dict(web=True), ["--web"]),
    (dict(lod=True, max_sh_degree=1), ["--lod", "--max-sh-degree", 1]),
    (dict(lossless=True), ["--lossless"]),
    (dict(max_error=0.02, max_sh_degree=2), ["--max-error", 0.02, "--max-sh-degree", 2]),
    (dict(target_bytes=50_000), ["--target-bytes", 50_000]),
    (dict(prune=0.3), ["--prune", 0.3]),
    (dict(depth=8), ["--depth", 8]),
    (dict(depth=9, j_low=6), ["--depth", 9, "--j-low", 6]),
    (dict(cameras=ROOM), ["--cameras", ROOM]),
    (
        dict(cameras=ROOM, drop_unseen=True, prune=0.1),
        ["--cameras", ROOM, "--drop-unseen", "--prune", 0.1],
    ),
    (dict(cameras=ROOM, target_psnr=36), ["--cameras", ROOM, "--target-psnr", 36]),
]


@pytest.mark.parametrize("options, flags", CASES, ids=lambda case: None)
def test_encode(command, splats, tmp_path, options, flags):
    path = tmp_path / "command.gsvx"
    command("encode", MODEL, "-o", path, *flags)
    assert gsvx.compress_to_bytes(splats, **options) == path.read_bytes()


@pytest.mark.parametrize("options, flags", [({}, []), (dict(max_sh_degree=1), ["--max-sh-degree", 1])])
def test_decode(command, splats, tmp_path, options, flags):
    stream, model = tmp_path / "room.gsvx", tmp_path / "room.ply"
    gsvx.compress(stream, splats, quality=40)
    command("decode", stream, "-o", model, *flags)
    assert equal(gsvx.decompress(stream, **options), gsvx.read_model(model))


@pytest.mark.parametrize("name", ["room.ply", "room.spz", "room.splat"])
def test_convert(command, splats, tmp_path, name):
    command("convert", MODEL, tmp_path / name)
    ours = tmp_path / f"ours-{name}"
    gsvx.write_model(ours, splats)
    assert ours.read_bytes() == (tmp_path / name).read_bytes()


def test_a_stream_in_gltf_is_read_as_it_decodes(command, splats, tmp_path):
    stream, model = tmp_path / "room.gsvx", tmp_path / "room.glb"
    gsvx.compress(stream, splats, quality=40)
    command("convert", stream, model, "--compress")
    assert equal(gsvx.read_model(model), gsvx.decompress(stream))
    model.write_bytes(model.read_bytes().replace(b'"bufferView":0', b'"bufferView":9'))
    with pytest.raises(gsvx.Error, match="bufferView that is not there"):
        gsvx.read_model(model)


def test_tune(command, splats, tmp_path):
    path = tmp_path / "command.gsvx"
    command("tune", MODEL, "--cameras", ROOM, "-o", path, "--effort", "quick", "--target-bytes", 20_000, "--web")
    ours = tmp_path / "ours.gsvx"
    report = gsvx.tune(ours, splats, ROOM, effort="quick", target_bytes=20_000, web=True)
    assert ours.read_bytes() == path.read_bytes()
    assert report.bytes <= 20_000 and not report.distilled


def test_tune_to_several_qualities(command, splats, tmp_path):
    path = tmp_path / "command.gsvx"
    command("tune", MODEL, "--cameras", ROOM, "-o", path, "--effort", "quick", "--qualities", "30,45.5")
    report = gsvx.tune(tmp_path / "ours.gsvx", splats, ROOM, effort="quick", qualities=[30, 45.5])
    (further,) = report.further
    for made in (report, further):
        ours = tmp_path / f"ours-q{made.quality:g}.gsvx"
        assert ours.read_bytes() == path.with_name(f"command-q{made.quality:g}.gsvx").read_bytes()
        assert made.bytes == ours.stat().st_size
    assert (report.quality, further.quality) == (45.5, 30)
    assert not (tmp_path / "ours.gsvx").exists()
