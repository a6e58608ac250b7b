"""Parts of a large scene with the gsvx command: plan, encode, join. Each is a function of its arguments alone.

Files are local paths, or whatever fsspec reads and writes.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import subprocess
import tempfile
from bisect import bisect_left
from itertools import accumulate
from pathlib import Path
from typing import List, NamedTuple, Sequence

import fsspec


class Failed(Exception):
    """The command refuses: another try ends alike. The message is for a person."""


class Killed(Exception):
    """The command was killed, by the system or by a person: another try may succeed."""


class Model(NamedTuple):
    """A model of the scene."""

    url: str
    #: Where it is on every machine: the file itself, or a copy of it.
    path: str
    #: Tells the file from what was there before.
    key: str


def find_command(given: str | None) -> str:
    """The gsvx command: as given, or what the variable GSVX names, or the one on PATH."""
    found = given or os.environ.get("GSVX") or shutil.which("gsvx")
    if not found:
        raise Failed("the gsvx command is not on PATH: cargo install --path crates/gsvx-cli, or name it with --gsvx")
    return found


def run(command: str, *words: object) -> None:
    """Runs the command."""
    done = subprocess.run([command, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    said = (done.stderr.strip().splitlines() or ["nothing said why"])[-1]
    # A shell says 128 + 9 where a process says -9.
    if done.returncode < 0 or done.returncode == 137:
        raise Killed(f"gsvx {words[0]} was killed: is there too little memory?")
    if done.returncode != 0:
        raise Failed(said.removeprefix("error: "))


def models(patterns: Sequence[str], cache: str) -> List[Model]:
    """The models that patterns name, in the order of their names. A model that is not local gets a place in `cache`."""
    found = []
    for pattern in patterns:
        fs, path = fsspec.url_to_fs(pattern)
        paths = sorted(fs.glob(path)) if any(c in path for c in "*?[") else [path]
        if not paths or not all(map(fs.exists, paths)):
            raise Failed(f"{pattern}: there is no such file")
        for path in paths:
            key = hashlib.sha256(f"{path} {fs.ukey(path)}".encode()).hexdigest()[:16]
            if is_local(fs):
                found.append(Model(path, path, key))
            else:
                # Of "zip://*.ply::s3://...", what is behind the first "::" stays.
                url = fs.unstrip_protocol(path) + "".join(pattern.partition("::")[1:])
                # A file that changes gets another place.
                found.append(Model(url, os.path.join(cache, key, path.rsplit("/", 1)[-1]), key))
    return found


def is_local(fs: fsspec.AbstractFileSystem) -> bool:
    """Whether its paths are those of this machine and its network file systems."""
    return isinstance(fs, fsspec.implementations.local.LocalFileSystem)


def fetch(model: Model) -> None:
    """Copies a model to where it is looked for, unless it is there."""
    if os.path.exists(model.path):
        return
    folder = Path(model.path).parent
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        part = os.path.join(scratch, "part")
        fs, path = fsspec.url_to_fs(model.url)
        try:
            fs.get_file(path, part)
        except FileNotFoundError:
            raise Failed(f"{model.url}: there is no such file") from None
        os.replace(part, model.path)


def put(local: str, url: str) -> None:
    """Copies a file to a URL, which shows the whole file or none."""
    fs, path = fsspec.url_to_fs(url)
    fs.makedirs(fs._parent(path), exist_ok=True)
    unfinished = f"{path}.{secrets.token_hex(8)}.part"
    fs.put_file(local, unfinished)
    fs.mv(unfinished, path)


def plan(command: str, scene: Sequence[Model], options: Sequence[str]) -> bytes:
    """The plan of a scene."""
    for model in scene:
        fetch(model)
    with tempfile.TemporaryDirectory(prefix="gsvx-") as scratch:
        out = os.path.join(scratch, "plan")
        run(command, "plan", *options, "-o", out, *(m.path for m in scene))
        return Path(out).read_bytes()


def tiles(plan: bytes) -> List[int]:
    """The Gaussians of each tile."""
    return json.loads(plan)["plan"]["tile_counts"]


def inputs_of(plan: bytes, k: int, n: int) -> List[int]:
    """Which models have Gaussians in part `k` of `n`, with `k` from 1."""
    counts = tiles(plan)
    starts = [0, *accumulate(counts)][:-1]
    total = sum(counts)

    def first(k: int) -> int:
        return len(starts) if k >= n else bisect_left(starts, -(-total * k // n))

    own = range(first(k - 1), first(k))
    return [i for i, model in enumerate(json.loads(plan)["inputs"]) if any(t in own for t in model["tiles"])]


def encode(command: str, plan: bytes, k: int, n: int, scene: Sequence[Model], options: Sequence[str], url: str) -> None:
    """Encodes part `k` of `n`, with `k` from 1, and puts it where `url` says."""
    for i in inputs_of(plan, k, n):
        fetch(scene[i])
    with tempfile.TemporaryDirectory(prefix="gsvx-") as scratch:
        plan_file, out = os.path.join(scratch, "plan"), os.path.join(scratch, "part.gsvx")
        Path(plan_file).write_bytes(plan)
        run(command, "encode", plan_file, "--part", f"{k}/{n}", *options, "-o", out)
        put(out, url)


def join(command: str, urls: Sequence[str], output: str) -> int:
    """Joins parts; returns the bytes of the scene."""
    with tempfile.TemporaryDirectory(prefix="gsvx-") as scratch:
        parts = []
        for i, url in enumerate(urls):
            fs, path = fsspec.url_to_fs(url)
            if not is_local(fs):
                fs.get_file(path, os.path.join(scratch, str(i)))
                path = os.path.join(scratch, str(i))
            parts.append(path)
        joined = os.path.join(scratch, "joined.gsvx")
        run(command, "join", *parts, "-o", joined)
        put(joined, output)
        return os.path.getsize(joined)
