"""Measures the package against the gsvx command and writes docs/results/python.md.

    cargo build --release -p gsvx-cli
    pip install ./crates/gsvx-py
    python crates/gsvx-py/bench.py MODEL.ply ...

With --install it also makes an empty environment, installs the package into it with an empty cargo target
folder, runs the README's example, and measures the wheel. Figures that it does not measure are taken
from the page as it is.
"""

from __future__ import annotations

import argparse
import glob
import json
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
REPOSITORY = FOLDER.parents[1]
PAGE = REPOSITORY / "docs" / "results" / "python.md"
ROOM = REPOSITORY / "fixtures" / "room"

# What each process of Python does: its arguments are a model or stream and a place for the output. It prints
# seconds, processor seconds, bytes of the arrays, and the peak before and after in kB.
WORKER = """
import json, resource, sys, time
import numpy, gsvx
what, source, out = sys.argv[1:]
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
if what == "compress":
    splats = {n: numpy.load(f"{source}/{n}.npy") for n in "means scales quats opacities sh0 shN".split()}
before, start, cpu = peak(), time.perf_counter(), time.process_time()
if what == "compress":
    gsvx.compress(out, splats)
elif what == "lossless":
    gsvx.compress(out, source, lossless=True)
else:
    splats = gsvx.decompress(source)
seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
size = sum(a.nbytes for a in splats.values())
print(json.dumps(dict(seconds=seconds, cpu=cpu, arrays=size, before=before, peak=peak())))
"""
RUNS = 7


def run(words, **options):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}\n{done.stdout}{done.stderr}")
    return done.stdout


def measured(words):
    """Output, processor seconds and peak (kB) of a process."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(write, 1)
        os.execv(str(words[0]), [str(w) for w in words])
    os.close(write)
    with os.fdopen(read) as pipe:
        said = pipe.read()
    _, status, usage = os.wait4(child, 0)
    if status:
        sys.exit(f"{' '.join(map(str, words))} failed")
    return said, usage.ru_utime + usage.ru_stime, usage.ru_maxrss


def model_rows(command, model, folder):
    """The figures of a model: rows of the two tables."""
    import numpy as np

    import gsvx

    splats = gsvx.read_model(model)
    n = len(splats["means"])
    for name, array in splats.items():
        np.save(folder / f"{name}.npy", np.ascontiguousarray(array))
    del splats
    stream, other, ply = folder / "a.gsvx", folder / "b.gsvx", folder / "a.ply"
    encodes, decodes = ([], []), ([], [])
    for _ in range(RUNS):
        said, cpu, peak = measured([command, "encode", model, "-o", stream, "--force", "--json"])
        report = json.loads(said)
        encodes[0].append((report["encode_seconds"], cpu, peak))
        # The processor's time of a command that reads and does no more.
        ours = json.loads(run([sys.executable, "-c", WORKER, "compress", folder, other]))
        encodes[1].append(ours)
        said, cpu, peak = measured([command, "decode", stream, "-o", "/dev/null", "--force", "--json"])
        decodes[0].append((json.loads(said)["decode_seconds"], cpu, peak))
        decodes[1].append(json.loads(run([sys.executable, "-c", WORKER, "decompress", stream, "-"])))
    same = stream.read_bytes() == other.read_bytes()
    _, _, to_file = measured([command, "decode", stream, "-o", ply, "--force", "--json"])
    name = model.stem if model.parent.name == "models" else model.parent.name
    times, peaks = [], []
    for what, (theirs, ours) in (("compress", encodes), ("decompress", decodes)):
        a, b = min(t[0] for t in theirs), min(o["seconds"] for o in ours)
        times.append(
            f"| {name}, {n:,} | {what} | {a:.3f} | {b:.3f} | {100 * (b / a - 1):+.1f} % | "
            f"{min(o['cpu'] for o in ours):.2f} |"
        )
        command_peak = min(t[2] for t in theirs) if what == "compress" else to_file
        arrays, peak = ours[0]["arrays"] / 1e6, min(o["peak"] for o in ours) * 1024 / 1e6
        base = min(o["before"] for o in ours) * 1024 / 1e6
        base -= arrays if what == "compress" else 0
        command_peak *= 1024 / 1e6
        peaks.append(
            f"| {name} | {what} | {command_peak:.1f} | {arrays:.1f} | {base:.1f} | "
            f"{peak:.1f} | {peak - arrays - base - command_peak:+.1f} |"
        )
    print(*times, *peaks, f"same bytes: {same}", sep="\n")
    return times, peaks, same


def install():
    """Rows of the table about an empty environment."""
    with tempfile.TemporaryDirectory(dir=REPOSITORY / "target") as folder:
        folder = Path(folder)
        venv, target = folder / "venv", folder / "target"
        environment = {k: v for k, v in os.environ.items() if k not in ("VIRTUAL_ENV", "PYTHONPATH")}
        environment["CARGO_TARGET_DIR"] = str(target)
        start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        run([sys.executable, "-m", "venv", venv])
        python = venv / "bin" / "python"
        wheels = folder / "wheels"
        run([python, "-m", "pip", "wheel", "--no-deps", "-w", wheels, FOLDER], env=environment)
        (wheel,) = wheels.glob("*.whl")
        run([python, "-m", "pip", "install", wheel], env=environment)
        installed = time.perf_counter()
        text = (FOLDER / "README.md").read_text()
        (example,) = re.findall(r"```python example\n(.*?)```", text, re.DOTALL)
        (folder / "room").symlink_to(ROOM)
        said = run([python, "-c", example], cwd=folder).strip().splitlines()
        end, after = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return [
            f"| environment, wheel and installation, seconds | {installed - start:.0f} |",
            f"| the README's example, seconds | {end - installed:.1f} |",
            f"| processor seconds of both | {cpu:.0f} |",
            f"| processor seconds divided by {os.cpu_count()} cores | {cpu / os.cpu_count():.0f} |",
            f"| size of the wheel, MB | {wheel.stat().st_size / 1e6:.2f} |",
            f"| what the example says | {'; '.join(said)} |",
        ]


def kept(heading):
    """The rows of a table on the page as it is."""
    text = PAGE.read_text() if PAGE.exists() else ""
    found = re.search(rf"## {heading}\n.*?\n\|[-:| ]+\|\n(.*?)\n\n", text + "\n\n", re.DOTALL)
    return found[1].splitlines() if found else ["| not measured | |"]


def tests():
    """What pytest says in its last line."""
    words = [sys.executable, "-m", "pytest", "-q", FOLDER / "tests"]
    said = subprocess.run([str(w) for w in words], capture_output=True, text=True).stdout
    return said.strip().splitlines()[-1]


def processor():
    with open("/proc/cpuinfo") as file:
        return re.search(r"model name\s*: (.*)", file.read())[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("models", nargs="*", type=Path)
    parser.add_argument("--install", action="store_true")
    parser.add_argument("--command", type=Path, default=REPOSITORY / "target" / "release" / "gsvx")
    arguments = parser.parse_args()
    import numpy

    times, peaks, same = [], [], []
    for model in arguments.models:
        with tempfile.TemporaryDirectory() as folder:
            found = model_rows(arguments.command, model.resolve(), Path(folder))
            times, peaks, same = times + found[0], peaks + found[1], same + [found[2]]
    if same and not all(same):
        sys.exit("the streams are not those of the command")
    installed = install() if arguments.install else kept("From nothing")
    times, peaks = times or kept("How fast"), peaks or kept("How much memory")
    os.environ["GSVX"] = str(arguments.command)
    page = TEMPLATE.format(
        machine=f"{processor()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"numpy {numpy.__version__}",
        installed="\n".join(installed),
        times="\n".join(times),
        peaks="\n".join(peaks),
        runs=RUNS,
        tests=tests(),
    )
    PAGE.write_text(page)
    print(PAGE)


TEMPLATE = """# In Python

`python crates/gsvx-py/bench.py MODELS --install`, beside `target/release/gsvx`. {machine}.

## From nothing

An empty environment and an empty cargo target folder; crates and wheels come from the network or from its
caches. The aim is 5 minutes on 2 cores, and a wheel of at most 6 MB.

| | |
|---|---|
{installed}

## How fast

Seconds, the best of {runs} runs each, in turn. Of the command, `encode` is without the reading of the PLY and
without the writing, `decode` writes its PLY to /dev/null. Of Python: `gsvx.compress` from numpy arrays to a
file, `gsvx.decompress` from a file to arrays. The last column is processor time of Python's run. The
aim is 10 % more at most.

| model, Gaussians | | command | Python | more | processor |
|---|---|---:|---:|---:|---:|
{times}

The streams are byte for byte the same.

## How much memory

Peaks of the processes in MB, the best of {runs}. `base` is Python with numpy and the package before the call,
without the arrays; `beyond` is what Python takes beyond the command, the arrays and the base. The aim
is 0 at most.

| model | | command | arrays | base | Python | beyond |
|---|---|---:|---:|---:|---:|---:|
{peaks}

## How safe

`pytest crates/gsvx-py/tests`: {tests}. Among them: 1,000 streams with random damage are given to
`decompress_bytes` and to `open`, and every one is decoded as if it were whole or raises `gsvx.Error`; the
streams of 16 sets of options are those of the command.
"""

if __name__ == "__main__":
    main()
