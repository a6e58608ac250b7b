"""Measures the package against the gsvx command and writes docs/results/python.md.

    cargo build --release -p gsvx-cli
    pip install ./crates/gsvx-py
    python crates/gsvx-py/bench.py MODEL.ply ...

With --install it also makes an empty environment, installs the package into it with an empty cargo target
folder, runs the README's example, and measures the wheel, which stays in target/wheels. With --tests it runs the
tests. Figures that it does not measure are taken from the page as it is.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
REPOSITORY = FOLDER.parents[1]
PAGE = REPOSITORY / "docs" / "results" / "python.md"
ROOM = REPOSITORY / "fixtures" / "room"

# What each process of Python does: its arguments are a task, a model or stream, and a place for the output. It
# prints seconds, bytes of the arrays, and the peak before and after in kB.
WORKER = """
import json, re, sys, time
import numpy, gsvx
what, source, out = sys.argv[1:]
names = "means scales quats opacities sh0 shN".split()
splats = {}
if what == "prepare":
    splats = gsvx.read_model(source)
    for name in names:
        numpy.save(f"{out}/{name}.npy", numpy.ascontiguousarray(splats[name]))
if what == "compress":
    splats = {name: numpy.load(f"{source}/{name}.npy") for name in names}
def peak():
    with open("/proc/self/status") as file:
        return int(re.search(r"VmHWM:\\s+(\\d+)", file.read())[1])
before, start = peak(), time.perf_counter()
if what == "compress":
    gsvx.compress(out, splats)
elif what == "decompress":
    splats = gsvx.decompress(source)
seconds = time.perf_counter() - start
size = sum(a.nbytes for a in splats.values())
gaussians = len(splats["means"]) if splats else 0
print(json.dumps(dict(seconds=seconds, arrays=size, before=before, peak=peak(), gaussians=gaussians)))
"""
RUNS = 15


def run(words, **options):
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, words))}\n{done.stdout}{done.stderr}")
    return done.stdout


def worker(*words):
    return json.loads(run([sys.executable, "-c", WORKER, *words]))


def command(*words):
    """The report of the command, with its peak in kB. This process is small, for the peak of a child is at
    least that of the process that starts it."""
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
    return {**json.loads(said), "peak": usage.ru_maxrss}


def model_rows(gsvx, model, folder):
    """The figures of a model: rows of both tables."""
    prepared = worker("prepare", model, folder)
    stream, other, ply = (folder / name for name in ("a.gsvx", "b.gsvx", "a.ply"))
    runs = {name: [] for name in ("encode", "compress", "decode", "decompress")}
    for _ in range(RUNS):
        runs["encode"].append(command(gsvx, "encode", model, "-o", stream, "--force", "--json"))
        runs["compress"].append(worker("compress", folder, other))
        runs["decode"].append(command(gsvx, "decode", stream, "-o", "/dev/null", "--force", "--json"))
        runs["decompress"].append(worker("decompress", stream, "-"))
    if stream.read_bytes() != other.read_bytes():
        sys.exit(f"{model}: the stream is not that of the command")
    runs["decode to a file"] = [command(gsvx, "decode", stream, "-o", ply, "--json")]
    values = lambda name, value: [run[value] for run in runs[name]]  # noqa: E731
    best = lambda name, value: min(values(name, value))  # noqa: E731
    name = f"{model.parent.name}, {prepared['gaussians']:,}"
    times = [
        row(name, "compress", values("encode", "encode_seconds"), values("compress", "seconds")),
        row(name, "decompress", values("decode", "decode_seconds"), values("decompress", "seconds")),
    ]
    peaks = []
    for what, theirs in (("compress", "encode"), ("decompress", "decode to a file")):
        size = worker("decompress", stream, "-")["arrays"] if what == "decompress" else prepared["arrays"]
        base = best(what, "before") * 1024 - (size if what == "compress" else 0)
        a, b = best(theirs, "peak") * 1024, best(what, "peak") * 1024
        columns = [a, size, base, b]
        text = " | ".join(f"{v / 1e6:.1f}" for v in columns)
        peaks.append(f"| {name} | {what} | {text} | {(b - size - base - a) / 1e6:+.1f} |")
    print(*times, *peaks, sep="\n")
    return times, peaks


def row(name, what, theirs, ours):
    """The best of both, and the median of the ratios of runs that came one after the other."""
    more = 100 * (statistics.median(b / a for a, b in zip(theirs, ours)) - 1)
    return f"| {name} | {what} | {min(theirs):.3f} | {min(ours):.3f} | {more:+.1f} % |"


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
        wheels = REPOSITORY / "target" / "wheels"
        shutil.rmtree(wheels, ignore_errors=True)
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
            f"| processor seconds divided by {os.cpu_count()} cores | {cpu / os.cpu_count():.0f} |",
            f"| size of the wheel, MB | {wheel.stat().st_size / 1e6:.2f} |",
            f"| what the example says | {'; '.join(said)} |",
        ]


def kept(heading):
    """The rows of a table on the page as it is."""
    text = PAGE.read_text() if PAGE.exists() else ""
    found = re.search(rf"## {heading}\n.*?\n\|-[-:|]+\|\n(.*?)\n\n", text + "\n\n", re.DOTALL)
    return found[1].splitlines() if found else ["| not measured | |"]


def tests():
    """What pytest says in its last line, without its time."""
    words = [sys.executable, "-m", "pytest", "-q", FOLDER / "tests"]
    said = subprocess.run([str(w) for w in words], capture_output=True, text=True).stdout
    return said.strip().splitlines()[-1].split(" in ")[0]


def kept_tests():
    found = re.search(r"`pytest crates/gsvx-py/tests`: (.*?)\.", PAGE.read_text() if PAGE.exists() else "")
    return found[1] if found else "not run"


def processor():
    with open("/proc/cpuinfo") as file:
        return re.search(r"model name\s*: (.*)", file.read())[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("models", nargs="*", type=Path)
    parser.add_argument("--install", action="store_true")
    parser.add_argument("--tests", action="store_true")
    parser.add_argument("--command", type=Path, default=REPOSITORY / "target" / "release" / "gsvx")
    arguments = parser.parse_args()
    tables = [[], []]
    for model in arguments.models:
        with tempfile.TemporaryDirectory() as folder:
            found = model_rows(arguments.command, model.resolve(), Path(folder))
            tables = [table + rows for table, rows in zip(tables, found)]
    installed = install() if arguments.install else kept("From nothing")
    headings = ("How fast", "How much memory")
    times, peaks = (table or kept(heading) for table, heading in zip(tables, headings))
    os.environ["GSVX"] = str(arguments.command)
    page = TEMPLATE.format(
        machine=f"{processor()}, {os.cpu_count()} cores, load average {os.getloadavg()[0]:.0f}; "
        f"Python {platform.python_version()}, numpy {version('numpy')}",
        installed="\n".join(installed),
        times="\n".join(times),
        peaks="\n".join(peaks),
        runs=RUNS,
        tests=tests() if arguments.tests else kept_tests(),
    )
    PAGE.write_text(page)
    print(PAGE)


TEMPLATE = """# In Python

`python crates/gsvx-py/bench.py MODELS --install --tests`, beside `target/release/gsvx`. {machine}.

## From nothing

The aim is 5 minutes on 2 cores, and a wheel of at most 6 MB.

| | |
|---|---|
{installed}

## How fast

Seconds, the best of {runs} runs each, in turn; `more` is the median over pairs of consecutive runs. The command encodes without file I/O and decodes to /dev/null; Python goes from arrays to a file and back. The aim is 10 % at most.

| model, Gaussians | | command | Python | more |
|---|---|---:|---:|---:|
{times}

## How much memory

Peaks of the processes in MB, the best of {runs}. `base` is Python before the call; `beyond` is Python less the command, the arrays and the base. The aim is 0 at most.

| model, Gaussians | | command | arrays | base | Python | beyond |
|---|---|---:|---:|---:|---:|---:|
{peaks}

## How safe

`pytest crates/gsvx-py/tests`: {tests}. 1,000 streams with random damage decode as if whole, or raise `gsvx.Error`. Streams of 19 sets of options are those of the command.
"""

if __name__ == "__main__":
    main()
