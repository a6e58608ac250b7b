"""The extension for Blender, without a window."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import gsvx
from conftest import MODEL, REPOSITORY, ROOM, equal, say_skipped

try:
    import bpy
    import mathutils
except ImportError as missing:
    say_skipped(f"bpy cannot be imported ({missing}): pip install 'bpy==5.0.*' in Python 3.11")

FOLDER = REPOSITORY / "crates" / "gsvx-py" / "integrations" / "blender"
STREAMS = REPOSITORY / "fixtures" / "streams"


@pytest.fixture(scope="module")
def extension():
    spec = importlib.util.spec_from_file_location("gsvx_blender", FOLDER / "__init__.py")
    module = sys.modules["gsvx_blender"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.register()
    yield module
    # bpy does not let the process end while classes are registered.
    module.unregister()


@pytest.fixture(autouse=True)
def empty(extension):
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes, *bpy.data.materials, *bpy.data.node_groups])


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("blender") / "room.gsvx"
    gsvx.compress(path, MODEL)
    return str(path)


def imported(path, **options):
    assert bpy.ops.import_scene.gsvx(filepath=str(path), **options) == {"FINISHED"}
    return bpy.context.object


def error_of(operator, **options) -> str:
    """The one line of an operator that fails."""
    with pytest.raises(RuntimeError) as caught:
        operator(**options)
    (line,) = str(caught.value).strip().splitlines()
    return line


def psnr(a, b) -> float:
    return float(-10 * np.log10(np.mean((np.clip(a, 0, 1) - np.clip(b, 0, 1)) ** 2)))


def columns(mesh):
    found = {"position": np.empty(3 * len(mesh.vertices), np.float32)}
    mesh.vertices.foreach_get("co", found["position"])
    for attribute in mesh.attributes:
        if attribute.data_type == "FLOAT":
            found[attribute.name] = np.empty(len(attribute.data), np.float32)
            attribute.data.foreach_get("value", found[attribute.name])
    return found


def test_attributes_are_those_of_blenders_own_import_of_the_ply(room, tmp_path):
    own = columns(imported(room, z_up=False).data)
    gsvx.write_model(tmp_path / "room.ply", gsvx.decompress(room))
    bpy.ops.wm.ply_import(filepath=str(tmp_path / "room.ply"))
    theirs = columns(bpy.context.object.data)
    # Blender's import has the normals of the PLY too, which mean nothing.
    normals = theirs.keys() - own.keys()
    assert normals <= {"nx", "ny", "nz"} and own.keys() == theirs.keys() - normals
    assert equal(own, {name: theirs[name] for name in own})
    assert len(own) == 1 + 59 - 3


@pytest.mark.parametrize("stream", ["default.gsvx", "degree-0.gsvx", "outliers.gsvx", "empty.gsvx"])
def test_what_is_not_turned_is_bit_for_bit_the_decode(extension, stream):
    item = imported(STREAMS / stream, z_up=False)
    assert equal(extension.operators.from_mesh(item.data), gsvx.decompress(STREAMS / stream))


def test_turned_splats_look_the_same_from_turned_cameras(extension, room):
    some = mathutils.Matrix.LocRotScale((1, -2, 3), mathutils.Euler((0.4, 2.5, -1)), (2.5, 2.5, 2.5))
    splats, cameras = gsvx.decompress(room), gsvx.read_cameras(ROOM, "test")[:2]
    expected = gsvx.render(splats, cameras)
    for matrix in (extension.turning.Z_UP, np.array(some, np.float64)):
        views = cameras.viewmats @ np.linalg.inv(matrix)
        # A scale belongs to the scene, not to the cameras.
        views[:, :3] *= np.cbrt(np.linalg.det(matrix[:3, :3]))
        found = gsvx.render(extension.turning.turned(splats, matrix), (views, cameras.Ks, cameras.sizes))
        for a, b in zip(expected, found):
            assert psnr(a, b) > 45


def test_up_is_up(room):
    still, item = imported(room, z_up=False), imported(room)
    x, y, z = columns(still.data)["position"].reshape(-1, 3).T
    assert np.array_equal(columns(item.data)["position"].reshape(-1, 3), np.stack([x, z, -y], 1))


def test_an_exported_scene_looks_like_the_imported_one(room, tmp_path):
    out = str(tmp_path / "out.gsvx")
    imported(room)
    assert bpy.ops.export_scene.gsvx(filepath=out, quality=100) == {"FINISHED"}
    cameras = gsvx.read_cameras(ROOM, "test")
    assert gsvx.compare(room, gsvx.decompress(out), cameras).psnr > 45
    bpy.ops.export_scene.gsvx(filepath=out, quality=20)
    assert gsvx.compare(room, gsvx.decompress(out), cameras).psnr < 45


def test_an_object_that_was_moved_is_exported_where_it_is(extension, room, tmp_path):
    item = imported(room)
    item.matrix_world = mathutils.Matrix.LocRotScale((1, 2, 3), mathutils.Euler((1, 2, 3)), (2, 2, 2))
    bpy.ops.export_scene.gsvx(filepath=str(tmp_path / "moved.gsvx"), quality=100)
    there = imported(tmp_path / "moved.gsvx")
    local = columns(item.data)["position"].reshape(-1, 3)
    world = local @ np.array(item.matrix_world)[:3, :3].T + np.array(item.matrix_world)[:3, 3]
    low, high = (f(columns(there.data)["position"].reshape(-1, 3), axis=0) for f in (np.min, np.max))
    assert np.allclose(low, world.min(axis=0), atol=0.05) and np.allclose(high, world.max(axis=0), atol=0.05)


def test_a_coarse_level_is_imported_where_the_stream_has_it():
    with gsvx.open(STREAMS / "lod.gsvx") as stream:
        counts = [sum(chunk.gaussians for chunk in stream.of_lod(lod)) for lod in range(stream.lods)]
    for lod, count in [*enumerate(counts), (9, counts[-1])]:
        assert len(imported(STREAMS / "lod.gsvx", lod=lod).data.vertices) == count
    assert counts[0] > counts[1] > counts[2]


def test_what_cannot_be_imported_is_one_line_and_nothing_is_imported(room, tmp_path):
    cut, garbage, absent = (tmp_path / name for name in ("cut.gsvx", "garbage.gsvx", "absent.gsvx"))
    cut.write_bytes(Path(room).read_bytes()[:-1000])
    garbage.write_bytes(b"no stream" * 100)
    for path, text in [(cut, "truncated"), (garbage, "not a gsvx stream"), (absent, "No such file")]:
        line = error_of(bpy.ops.import_scene.gsvx, filepath=str(path))
        assert line.startswith(f"Error: {path}: ") and text in line and "; c" in line, line
        assert line.count(str(path)) == 1 and "salvage" not in line, line
    assert not bpy.data.objects and not bpy.data.meshes and not bpy.data.materials


def test_what_cannot_be_exported_is_one_line_and_no_file(room, tmp_path):
    def refused(text: str, out=tmp_path / "out.gsvx") -> None:
        line = error_of(bpy.ops.export_scene.gsvx, filepath=str(out))
        assert line.startswith("Error: room: ") and text in line and ";" in line, line
        assert not out.exists()

    item = imported(room)
    refused("there is no folder", tmp_path / "absent" / "out.gsvx")
    item.scale = (1, 2, 1)
    refused("make it the same")
    item.scale = (-1, -1, -1)
    refused("mirrors")
    item.scale = (1, 1, 1)
    item.data.attributes["scale_1"].data[7].value = np.nan
    refused("Gaussian 7: ")
    item.data.attributes.remove(item.data.attributes["f_rest_44"])
    refused("44 attributes f_rest_*")
    item.data.attributes.remove(item.data.attributes["opacity"])
    for i in range(44):
        item.data.attributes.remove(item.data.attributes[f"f_rest_{i}"])
    refused("no number opacity")


def camera_of(cameras, matrix):
    """Blender's camera for the first of some cameras."""
    data = bpy.data.cameras.new("camera")
    data.sensor_fit, data.clip_start = "HORIZONTAL", 0.01
    data.lens = data.sensor_width * cameras.Ks[0, 0, 0] / cameras.sizes[0, 0]
    item = bpy.data.objects.new("camera", data)
    item.matrix_world = mathutils.Matrix(
        matrix @ np.linalg.inv(cameras.viewmats[0]) @ np.diag([1.0, -1, -1, 1])
    )
    bpy.context.scene.collection.objects.link(item)
    return item


def test_the_preview_looks_like_the_scene(extension, room, tmp_path):
    if "cycles" not in bpy.context.preferences.addons:
        say_skipped("this bpy has no Cycles; the preview was not rendered")
    scene, cameras = bpy.context.scene, gsvx.read_cameras(ROOM, "test")
    imported(room)
    scene.camera = camera_of(cameras, extension.turning.Z_UP)
    width, height = (int(n) for n in cameras.sizes[0])
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.transparent_max_bounces = 8, 256
    scene.world = bpy.data.worlds.new("black")
    scene.world.color = (0, 0, 0)
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.filepath = str(tmp_path / "preview.png")
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(4 * width * height, np.float32)
    picture.pixels.foreach_get(pixels)
    found = pixels.reshape(height, width, 4)[::-1, :, :3]
    # The light of Cycles is noisy, and the preview has the colour of degree 0 alone.
    assert psnr(gsvx.render(gsvx.decompress(room), cameras)[0], found) > 22


WHEELS = [
    "gsvx-1.2.3-cp39-abi3-manylinux_2_34_x86_64.whl",
    "gsvx-1.2.3-cp39-abi3-win_amd64.whl",
    "gsvx-1.2.3-cp39-abi3-macosx_10_12_x86_64.macosx_11_0_arm64.macosx_10_12_universal2.whl",
]


def packed(folder: Path, names) -> subprocess.CompletedProcess:
    for name in names:
        with zipfile.ZipFile(folder / name, "w") as wheel:
            wheel.writestr("gsvx/__init__.py", "")
    words = [sys.executable, FOLDER / "pack.py", *(folder / name for name in names), "-o", folder]
    return subprocess.run(words, capture_output=True, text=True)


def test_blender_accepts_the_packed_extension(tmp_path):
    done = packed(tmp_path, WHEELS)
    assert done.returncode == 0, done.stderr
    path = Path(done.stdout.strip())
    assert path.name == "gsvx-blender-1.2.3.zip"
    tool = Path(bpy.utils.resource_path("LOCAL")) / "scripts/addons_core/bl_pkg/cli/blender_ext.py"
    done = subprocess.run([sys.executable, tool, "validate", path], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    text = zipfile.ZipFile(path).read("blender_manifest.toml").decode()
    assert all(f"./wheels/{name}" in text for name in WHEELS)
    assert "platforms = ['linux-x64', 'macos-arm64', 'macos-x64', 'windows-x64']" in text
    assert 'version = "1.2.3"' in text


def test_wheels_of_two_versions_are_not_packed(tmp_path):
    done = packed(tmp_path, [WHEELS[0], WHEELS[1].replace("1.2.3", "1.2.4")])
    assert done.returncode == 1 and "several versions: 1.2.3, 1.2.4" in done.stderr
