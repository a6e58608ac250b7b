"""What the tests share."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Callable, Dict

import numpy as np
import pytest

import gsvx

REPOSITORY = Path(__file__).resolve().parents[3]
ROOM = REPOSITORY / "fixtures" / "room"
MODEL = ROOM / "point_cloud.ply"


def say_skipped(why: str) -> None:
    """Skips a test, so that one sees it without -rs."""
    print(f"SKIPPED: {why}", file=sys.__stderr__)
    pytest.skip(why, allow_module_level=True)


@pytest.fixture()
def splats() -> Dict[str, np.ndarray]:
    return gsvx.read_model(MODEL)


@pytest.fixture()
def small(splats) -> Dict[str, np.ndarray]:
    return {name: array[:400] for name, array in splats.items()}


@pytest.fixture(scope="session")
def command() -> Callable[..., str]:
    """Runs the gsvx command and returns what it prints: the one in the variable GSVX, or the newest that cargo has built."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    name = "gsvx.exe" if sys.platform == "win32" else "gsvx"
    built = [p for p in (target / profile / name for profile in ("debug", "release")) if p.exists()]
    found = os.environ.get("GSVX") or max(built, key=os.path.getmtime, default=None)
    if found is None:
        say_skipped("the gsvx command is not built: cargo build -p gsvx-cli")

    def run(*words: object) -> str:
        done = subprocess.run(
            [str(found), *map(str, words)], check=True, capture_output=True, text=True
        )
        return done.stdout

    run.path = str(found)
    return run


@pytest.fixture()
def python() -> str:
    return shutil.which("python") or sys.executable


def equal(a: Dict[str, np.ndarray], b: Dict[str, np.ndarray]) -> bool:
    """Bit for bit the same."""
    assert a.keys() == b.keys()
    same = lambda x, y: x.shape == y.shape and x.tobytes() == y.tobytes()  # noqa: E731
    return all(same(a[name], b[name]) for name in a)
