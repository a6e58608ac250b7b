"""Decodes the golden streams of fixtures/streams and compares the hashes of their floats."""
import hashlib
import importlib.util
import sys
import time
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "fixtures" / "streams"

def scene_hash(stream):
    from gsvx_decoder import decode
    scene = decode(stream)
    arrays = scene.means, scene.rotations, scene.log_scales, scene.opacity_logits, scene.sh
    return hashlib.sha256(b"".join(values.tobytes() for values in arrays)).hexdigest()

def verdict(name, expected):
    try:
        return "passed" if scene_hash((FOLDER / name).read_bytes()) == expected else "FAILED: other floats"
    except Exception as error:  # fails this stream, not the others
        return f"FAILED: {type(error).__name__}: {error}"

if importlib.util.find_spec("numpy") is None:
    print("SKIPPED: the second decoder did not run, because numpy is missing (remedy: pip install numpy)")
    sys.exit(0)
failed = passed = 0
for line in (FOLDER / "hashes.txt").read_text().splitlines():
    if not line.startswith("#"):
        expected, name = line.split()
        start, result = time.time(), verdict(name, expected)
        passed, failed = passed + (result == "passed"), failed + (result != "passed")
        print(f"{name}: {result}, {time.time() - start:.1f} s", flush=True)
print(f"{passed} passed, {failed} failed")
sys.exit(failed > 0 or passed == 0)
