"""`python -m gsvx.ray`: the stream of one machine, whatever dies on the way."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import List

import numpy as np
import pytest

import gsvx
from conftest import say_skipped

try:
    import ray  # noqa: F401
    import fsspec  # noqa: F401
except ImportError as missing:
    say_skipped(f"{missing.name} is not installed: pip install 'gsvx[ray]'")

EACH = 150_000


class City:
    """Models of several tiles side by side, and the stream that one process makes of them."""

    def __init__(self, folder: Path, command) -> None:
        self.models: List[Path] = []
        random = np.random.default_rng(5)
        for i in range(3):
            means = random.uniform(0, 10, (EACH, 3)).astype(np.float32)
            means[:, 0] += 10 * i
            splats = {
                "means": means,
                "scales": np.full((EACH, 3), -3, np.float32),
                "quats": np.tile(np.float32([1, 0, 0, 0]), (EACH, 1)),
                "opacities": np.full(EACH, 2, np.float32),
                "sh0": (means * 0.1 % 1)[:, None, :],
                "shN": np.zeros((EACH, 0, 3), np.float32),
            }
            self.models.append(folder / f"tile-{i}.ply")
            gsvx.write_model(self.models[-1], splats)
        stream = folder / "one-machine.gsvx"
        command("encode", *self.models, "-q", "40", "-o", stream)
        self.pattern = str(folder / "tile-*.ply")
        self.stream = stream.read_bytes()


@pytest.fixture(scope="module")
def city(tmp_path_factory, command) -> City:
    return City(tmp_path_factory.mktemp("city"), command)


@pytest.fixture(scope="module")
def gsvx_command(command) -> str:
    return command.path


def encode(gsvx_command: object, *words: object, **env: str) -> subprocess.CompletedProcess:
    """Runs the driver on a cluster of its own, with several worker processes."""
    options = ["--gsvx", gsvx_command, "--parts", "4", "-q", "40"]
    line = [sys.executable, "-m", "gsvx.ray", "encode", *words, *options]
    return subprocess.run([str(w) for w in line], capture_output=True, text=True, env={**os.environ, **env})


def wrapper(folder: Path, gsvx_command: str, first: str) -> Path:
    """A command that does `first` at the first part, and then what gsvx does."""
    path = folder / "wrapper"
    once = f'[ "$1" = encode ] && mkdir "{folder}/once" 2>/dev/null'
    path.write_text(f'#!/bin/sh\nif {once}; then {first}; fi\nexec "{gsvx_command}" "$@"\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


def error_line(done: subprocess.CompletedProcess) -> str:
    assert done.returncode == 1, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1 and "Traceback" not in done.stderr, done.stderr
    return lines[0]


def test_a_worker_that_is_killed_changes_no_byte(city, gsvx_command, tmp_path):
    killing = wrapper(tmp_path, gsvx_command, "kill -9 $PPID; sleep 1; exit 1")
    done = encode(killing, city.pattern, "-o", tmp_path / "city.gsvx")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "once").exists()
    assert "part 4 of 4 is encoded" in done.stderr, done.stderr
    assert (tmp_path / "city.gsvx").read_bytes() == city.stream
    assert not (tmp_path / "city.gsvx.parts").exists()


def test_a_rerun_goes_on_with_the_parts_that_are_there(city, gsvx_command, tmp_path):
    # The command of the first part is killed each time, and each retry with it.
    output = tmp_path / "city.gsvx"
    always = wrapper(tmp_path, gsvx_command, "true")
    always.write_text(always.read_text().replace("\nexec", '\ncase "$4" in 2/4) kill -9 $$;; esac\nexec'))
    assert "killed: is there too little memory" in error_line(encode(always, city.pattern, "-o", output))
    assert not output.exists()
    # A model that was replaced is another scene, also where the plan is the same.
    model = city.models[0]
    os.utime(model, ns=(0, model.stat().st_mtime_ns + 1))
    assert "encoded already" not in encode(always, city.pattern, "-o", output).stderr
    done = encode(gsvx_command, city.pattern, "-o", os.path.relpath(output))
    assert "parts are encoded already" in done.stderr, done.stderr
    assert output.read_bytes() == city.stream
    assert "exists; pass --force" in error_line(encode(gsvx_command, city.pattern, "-o", output))


def test_a_poisoned_model_is_named(city, gsvx_command, tmp_path):
    cut, garbage = tmp_path / "cut.ply", tmp_path / "garbage.ply"
    cut.write_bytes(city.models[0].read_bytes()[:-1000])
    garbage.write_bytes(b"no model" * 100)
    for bad in (cut, garbage, tmp_path / "absent.ply"):
        done = encode(gsvx_command, city.models[1], bad, "-o", tmp_path / "city.gsvx")
        assert bad.name in error_line(done)
    assert not (tmp_path / "city.gsvx").exists()


def test_models_and_stream_need_not_be_local(city, gsvx_command, tmp_path):
    with zipfile.ZipFile(tmp_path / "tiles.zip", "w") as archive:
        for model in city.models:
            archive.write(model, model.name)
    # A file system of fsspec that is not the local one, though its files are.
    remote = tmp_path / "remote"
    remote.mkdir()
    done = encode(
        gsvx_command,
        f"zip://*.ply::{tmp_path}/tiles.zip",
        "-o",
        "dir://city.gsvx",
        "--cache",
        tmp_path / "cache",
        FSSPEC_DIR=f'{{"path": "{remote}", "target_protocol": "file"}}',
    )
    assert done.returncode == 0, done.stderr
    assert [p.name for p in remote.iterdir()] == ["city.gsvx"]
    assert (remote / "city.gsvx").read_bytes() == city.stream
