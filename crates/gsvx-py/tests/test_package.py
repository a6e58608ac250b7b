"""What comes with the package: its README's example, types, documentation."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import REPOSITORY, ROOM

import gsvx

FOLDER = REPOSITORY / "crates" / "gsvx-py"


def test_the_readmes_example_runs(tmp_path):
    text = (FOLDER / "README.md").read_text()
    (example,) = re.findall(r"```python example\n(.*?)```", text, re.DOTALL)
    assert len(example.strip().splitlines()) <= 10
    (tmp_path / "room").symlink_to(ROOM)
    done = subprocess.run([sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "room.gsvx").exists() and "dB" in done.stdout


def test_the_curve_is_plotted(tmp_path):
    pytest.importorskip("matplotlib")
    script = FOLDER / "examples" / "curve.py"
    words = [sys.executable, script, ROOM, "-o", tmp_path / "curve.png"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "curve.png").stat().st_size > 10_000
    assert done.stdout.count(" dB") == 5


def test_the_documented_default_is_the_default():
    assert f"(default: quality {gsvx.DEFAULT_QUALITY:g})" in gsvx.compress.__doc__


def test_everything_public_is_documented():
    for name in gsvx.__all__:
        value = getattr(gsvx, name)
        if inspect.isfunction(value) or inspect.isclass(value):
            assert inspect.getdoc(value), name


def test_types():
    pytest.importorskip("mypy")
    package = Path(gsvx.__file__).parent
    assert (package / "py.typed").exists() and (package / "_gsvx.pyi").exists()
    words = [sys.executable, "-m", "mypy", "--strict", str(FOLDER / "python" / "gsvx")]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    words = [sys.executable, "-m", "mypy.stubtest", "gsvx._gsvx"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
