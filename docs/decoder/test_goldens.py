"""Decodes the golden streams of fixtures/streams and compares the hashes of their floats."""
import hashlib
import importlib.util
import sys
import time
from pathlib import Path

FIXTURES = Path(__file__).resolve().parents[2] / "fixtures"
FOLDER = FIXTURES / "streams"

def scene_hash(stream):
    from gsvx_decoder import Scene, decode
    if stream[8] == 2:
        import numpy
        from sequence import decode_frames
        scene = Scene(*map(numpy.concatenate, zip(*decode_frames(stream))))
    else:
        scene = decode(stream)
    arrays = scene.means, scene.rotations, scene.log_scales, scene.opacity_logits, scene.sh
    return hashlib.sha256(b"".join(values.tobytes() for values in arrays)).hexdigest()

def marks(stream):
    """What else the head says of the scene."""
    from gsvx_decoder import Head
    if stream[8] == 2:
        return ""
    head = Head(stream)
    if not head.antialiased and not any(head.origin):
        return ""
    return "antialiased %s, origin %.15g %.15g %.15g" % (str(head.antialiased).lower(), *head.origin)

def passes(name, expected, marked):
    start, result = time.time(), "passed"
    try:
        stream = (FIXTURES / name).read_bytes()
        if scene_hash(stream) != expected:
            result = "FAILED: other floats"
        if marks(stream) != marked:
            result = "FAILED: another origin, or not as antialiased"
    except Exception as error:  # fails this stream, not the others
        result = f"FAILED: {type(error).__name__}: {error}"
    print(f"{name}: {result}, {time.time() - start:.1f} s", flush=True)
    return result == "passed"

def trace_is_the_same():
    from trace import trace
    made = trace((FOLDER / "default.gsvx").read_bytes()).splitlines()
    kept = (FOLDER / "default.trace").read_text().splitlines()
    wrong = next((i for i, (a, b) in enumerate(zip(made, kept)) if a != b), min(len(made), len(kept)))
    same = made == kept
    print("default.trace: passed" if same else f"default.trace: FAILED: differs at line {wrong + 1}")
    return same

if importlib.util.find_spec("numpy") is None:
    print("SKIPPED: the second decoder did not run, because numpy is missing (remedy: pip install numpy)")
    sys.exit(0)
lines = []
for folder in ("streams", "sequences"):
    for line in (FIXTURES / folder / "hashes.txt").read_text().splitlines():
        if line[0] != "#":
            expected, name, marked = (line + "  ").split("  ")[:3]
            lines.append((expected, f"{folder}/{name}", marked))
passed = sum([passes(name, expected, marked) for expected, name, marked in lines] + [trace_is_the_same()])
failed = len(lines) + 1 - passed
print(f"{passed} passed, {failed} failed")
sys.exit(failed > 0)
