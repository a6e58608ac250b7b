"""The interface of gsplat's PngCompression, as gsplat publishes it."""

from __future__ import annotations

import ast
import hashlib
import inspect
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from conftest import equal, say_skipped

import gsvx

VERSION = "1.5.3"
SHA256 = "515a3773641f5e7f7717acab6276c0b1d6dbcad087b7968ca653337c3189a982"


@pytest.fixture(scope="module")
def published(tmp_path_factory):
    """The class PngCompression and the function export_splats of the published source."""
    folder = tmp_path_factory.mktemp("gsplat")
    words = ["download", f"gsplat=={VERSION}", "--no-deps", "--quiet", "--dest", str(folder)]
    fetched = subprocess.run([sys.executable, "-m", "pip", *words], capture_output=True, text=True)
    wheels = list(folder.glob("*.whl"))
    if fetched.returncode or not wheels:
        say_skipped(f"gsplat {VERSION} cannot be fetched: {fetched.stderr.strip()[-200:]}")
    assert hashlib.sha256(wheels[0].read_bytes()).hexdigest() == SHA256
    with zipfile.ZipFile(wheels[0]) as wheel:
        names = ["gsplat/compression/png_compression.py", "gsplat/exporter.py"]
        found = {}
        for name in names:
            for node in ast.parse(wheel.read(name)).body:
                found[getattr(node, "name", "")] = node
    return found


def arguments(function: ast.FunctionDef):
    return [argument.arg for argument in function.args.args]


def test_methods_have_the_published_signatures(published):
    methods = {
        node.name: node
        for node in published["PngCompression"].body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    }
    assert set(methods) == {"compress", "decompress"}
    for name, method in methods.items():
        ours = inspect.signature(getattr(gsvx.GsvxCompression, name))
        assert list(ours.parameters) == arguments(method)
    assert ast.unparse(methods["compress"].returns) == "None"
    fields = [node for node in published["PngCompression"].body if isinstance(node, ast.AnnAssign)]
    assert all(field.value is not None for field in fields), "it is made without arguments"
    gsvx.GsvxCompression()


def test_names_and_shapes_are_the_published_ones(published, splats):
    text = ast.unparse(published["PngCompression"])
    assert [name for name in splats if f"'{name}'" not in text] == []
    checks = [ast.unparse(n.test) for n in ast.walk(published["export_splats"]) if isinstance(n, ast.Assert)]
    assert len(checks) == 6

    class Shape(np.ndarray):
        pass

    back = gsvx.decompress_bytes(gsvx.compress_to_bytes(splats))
    scope = {**back, "total_splats": len(back["means"])}
    for check in checks:
        assert eval(check, {}, scope), check  # noqa: S307
    assert arguments(published["export_splats"])[:6] == list(
        ["means", "scales", "quats", "opacities", "sh0", "shN"]
    )


def as_arrays(splats):
    return {name: np.asarray(value) for name, value in splats.items()}


def test_a_trainers_round_trip(splats, tmp_path, capsys):
    folder = tmp_path / "compression"
    before = {name: array.copy() for name, array in splats.items()}
    method = gsvx.GsvxCompression(quality=50)
    assert method.compress(str(folder), splats) is None
    assert equal(splats, before)
    assert "Report(bytes=" in capsys.readouterr().out
    back = as_arrays(method.decompress(str(folder)))
    assert equal(back, gsvx.decompress(folder / "splats.gsvx"))
    assert method.report.gaussians == len(back["means"])


def test_zero_sh_degrees_were_lost_to_a_trainer(splats, tmp_path):
    splats["shN"] = np.zeros_like(splats["shN"])
    method = gsvx.GsvxCompression(verbose=False, options={"lod": True})
    method.compress(str(tmp_path), splats)
    assert gsvx.decompress(tmp_path / "splats.gsvx")["shN"].shape[1] == 0
    back = as_arrays(method.decompress(str(tmp_path)))
    assert back["shN"].shape == (len(back["means"]), 15, 3) and not back["shN"].any()


def test_tensors_of_torch(splats, tmp_path):
    torch = pytest.importorskip("torch")
    given = {name: torch.nn.Parameter(torch.tensor(array)) for name, array in splats.items()}
    assert gsvx.compress_to_bytes(given) == gsvx.compress_to_bytes(splats)
    method = gsvx.GsvxCompression(verbose=False)
    method.compress(str(tmp_path), torch.nn.ParameterDict(given))
    back = method.decompress(str(tmp_path))
    assert all(isinstance(value, torch.Tensor) for value in back.values())
