"""Decodes the golden streams of fixtures/streams and compares the hashes of the floats."""
import hashlib
import sys
import time
from pathlib import Path

try:
    from gsvx_decoder import decode
except ImportError as error:
    print(f"SKIPPED: the second decoder did not run: {error} (remedy: pip install numpy)")
    sys.exit(0)

FOLDER = Path(__file__).resolve().parents[2] / "fixtures" / "streams"


def scene_hash(scene):
    arrays = scene.means, scene.rotations, scene.log_scales, scene.opacity_logits, scene.sh
    return hashlib.sha256(b"".join(values.tobytes() for values in arrays)).hexdigest()


def main():
    lines = [line.split() for line in (FOLDER / "hashes.txt").read_text().splitlines() if line[0] != "#"]
    failed = 0
    for expected, name in lines:
        start = time.time()
        try:
            scene = decode((FOLDER / name).read_bytes())
            result = "passed" if scene_hash(scene) == expected else "FAILED: other floats"
            result = f"{result}, {len(scene.means)} Gaussians"
        except Exception as error:  # a decoder that stops is a failure of its stream alone
            result = f"FAILED: {type(error).__name__}: {error}"
        failed += result.startswith("FAILED")
        print(f"{name}: {result}, {time.time() - start:.1f} s", flush=True)
    print(f"{len(lines) - failed} passed, {failed} failed")
    sys.exit(failed > 0 or not lines)


if __name__ == "__main__":
    main()
