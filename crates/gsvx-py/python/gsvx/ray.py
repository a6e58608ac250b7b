"""A large scene encoded by a Ray cluster: `python -m gsvx.ray encode 'tiles/*.ply' -o city.gsvx`.

The plan and each part are tasks that depend on their arguments alone. Ray runs those again whose worker dies. The
stream is, byte for byte, that of `gsvx encode` on one machine.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import sys
import tempfile
from typing import Any, Dict, List, Sequence

try:
    import fsspec
    import ray
except ImportError as missing:
    sys.exit(f"error: {missing.name} is not installed: pip install 'gsvx[ray]'")

from . import _parts
from ._parts import Failed, Killed

#: How often a task is run again whose worker dies.
RETRIES = 5


def main(words: Sequence[str] | None = None) -> int:
    """The command line; returns its exit code."""
    args = arguments().parse_args(words)
    try:
        encode(args)
    except (Failed, Killed) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        say("interrupted; the same command goes on with the parts that are encoded")
        return 130
    return 0


def arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m gsvx.ray", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    add = commands.add_parser("encode", help="encode models as one scene").add_argument
    add("models", nargs="+", metavar="MODEL", help="models of one scene: paths or URLs of fsspec, with * and ?")
    add("-o", "--output", required=True, metavar="STREAM", help="the stream: a path or a URL of fsspec")
    add("--force", action="store_true", help="replace an existing output")
    add("-q", "--quality", type=float, metavar="Q", help="0 (smallest) to 100 (best)")
    add("--preset", metavar="NAME", help="a quality by name, as in gsvx encode")
    add("--max-sh-degree", type=int, metavar="DEGREE", help="highest SH degree to keep, 0 to 3")
    add("--cameras", metavar="PATH", help="a scene folder or camera file, at the same path on every machine")
    add("--drop-unseen", action="store_true", help="with --cameras: leave out what they see too little of")
    add("--lod", action="store_true", help="store levels of detail too")
    add("--drop-invalid", action="store_true", help="leave out Gaussians that are not finite")
    add("--parts", type=int, metavar="N", help="number of parts; two for each CPU of the cluster without it")
    add("--cpus", type=int, default=1, metavar="N", help="CPUs of a task (1)")
    add("--address", metavar="ADDRESS", help="the cluster, as for ray.init; one on this machine without it")
    add("--gsvx", metavar="PATH", help="the gsvx command on every machine; $GSVX or PATH says without it")
    add(
        "--cache",
        default=os.path.join(tempfile.gettempdir(), "gsvx-models"),
        metavar="FOLDER",
        help="where machines keep models that are not local (%(default)s)",
    )
    return parser


def say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def encode(args: argparse.Namespace) -> None:
    """Plans, encodes and joins."""
    out_fs, out_path = fsspec.url_to_fs(args.output)
    if out_fs.exists(out_path) and not args.force:
        raise Failed(f"{args.output}: exists; pass --force to replace it")
    # Workers have other working folders.
    output = out_path if _parts.is_local(out_fs) else args.output
    command = _parts.find_command(args.gsvx)
    scene = _parts.models(args.models, args.cache)
    if not ray.is_initialized():
        ray.init(address=args.address, log_to_driver=False, logging_level="ERROR")
    # A task that fails by itself fails again; one that is killed may not.
    task = {"num_cpus": args.cpus, "max_retries": RETRIES, "retry_exceptions": [Killed]}

    say(f"planning {len(scene)} models")
    plan = result(ray.remote(**task)(_parts.plan).remote(command, scene, plan_options(args)), "the plan")
    folder = output + ".parts"
    name = hashlib.sha256(b"".join([plan, *(model.key.encode() for model in scene)])).hexdigest()[:12]
    there = encoded(folder, name)
    n = parts(args, plan, there)
    urls = {k: f"{folder}/{name}-{k}-of-{n}.gsvx" for k in range(1, n + 1)}
    missing = [k for k in urls if (k, n) not in there]
    if len(missing) < n:
        say(f"{n - len(missing)} of {n} parts are encoded already")

    work = ray.remote(**task)(_parts.encode)
    held, options = ray.put(plan), ["--threads", str(args.cpus)]
    waiting = {work.remote(command, held, k, n, scene, options, urls[k]): k for k in missing}
    wait_for(waiting, n)
    size = _parts.join(command, list(urls.values()), output)
    fs, path = fsspec.url_to_fs(folder)
    fs.rm(path, recursive=True)
    say(f"{args.output}: {sum(_parts.tiles(plan))} Gaussians in {size} bytes, of {n} parts")


def plan_options(args: argparse.Namespace) -> List[str]:
    named = {"--quality": args.quality, "--preset": args.preset, "--max-sh-degree": args.max_sh_degree}
    named["--cameras"] = args.cameras and os.path.abspath(args.cameras)
    words = [word for name, value in named.items() if value is not None for word in (name, str(value))]
    given = {"--drop-invalid": args.drop_invalid, "--drop-unseen": args.drop_unseen, "--lod": args.lod}
    return words + [name for name, value in given.items() if value]


def encoded(folder: str, name: str) -> set[tuple[int, int]]:
    """The parts of a plan that an earlier run has encoded: k and n."""
    fs, path = fsspec.url_to_fs(folder)
    files = fs.ls(path, detail=False) if fs.exists(path) else []
    found = (re.search(rf"/{name}-(\d+)-of-(\d+)\.gsvx$", file) for file in files)
    return {(int(m[1]), int(m[2])) for m in found if m}


def parts(args: argparse.Namespace, plan: bytes, there: set[tuple[int, int]]) -> int:
    """The number of parts: as asked for, or that of an earlier run, or what keeps the cluster busy."""
    if args.parts is not None:
        if args.parts < 1:
            raise Failed("--parts: at least 1")
        return args.parts
    if there:
        return max(n for _, n in there)
    return max(1, min(len(_parts.tiles(plan)), 2 * int(ray.cluster_resources().get("CPU", 1)) // args.cpus))


def wait_for(waiting: Dict[ray.ObjectRef, int], n: int) -> None:
    """Waits for parts; the first that fails ends the others."""
    try:
        while waiting:
            [done], _ = ray.wait(list(waiting), num_returns=1)
            k = waiting.pop(done)
            result(done, f"part {k} of {n}")
            say(f"part {k} of {n} is encoded, {len(waiting)} left")
    finally:
        for task in waiting:
            ray.cancel(task)


def result(task: ray.ObjectRef, what: str) -> Any:
    """What a task returns; `what` names it in an error."""
    try:
        return ray.get(task)
    except ray.exceptions.RayTaskError as error:
        cause = error.cause
        if isinstance(cause, (Failed, Killed)):
            raise type(cause)(str(cause)) from None
        raise Failed(f"{what}: {cause}") from None
    except ray.exceptions.RayError as error:
        why = str(error).strip().splitlines()[0]
        raise Failed(f"{what}: its worker died {RETRIES + 1} times: {why}") from None


if __name__ == "__main__":
    sys.exit(main())
