"""frames: sequences, frame by frame."""

from __future__ import annotations

import io

import pytest
from conftest import REPOSITORY, equal

import gsvx

CLIP = REPOSITORY / "fixtures" / "sequences" / "births.gsvx"


def test_frames_are_those_that_the_command_writes(tmp_path, command, splats):
    folder, clip, out = tmp_path / "frames", tmp_path / "clip.gsvx", tmp_path / "out"
    folder.mkdir()
    for number in range(5):
        splats["means"] = splats["means"] + 0.01
        gsvx.write_model(folder / f"{number}.ply", splats)
    command("encode", folder, "-o", clip, "--fps", 12, "--group", 3, "--no-estimate")
    command("decode", clip, "-o", out, "--frames", "0..5")
    frames = gsvx.frames(clip)
    assert (frames.fps, len(frames), frames.groups) == (12, 5, [(0, 3), (3, 5)])
    written = [gsvx.read_model(path) for path in sorted(out.iterdir())]
    assert len(written) == 5
    assert all(equal(a, b) for a, b in zip(frames, written))
    assert equal(frames[3], written[3]) and equal(frames[-5], written[0])


def test_rows_come_and_go():
    frames = gsvx.frames(io.BytesIO(CLIP.read_bytes()))
    assert len({len(splats["means"]) for splats in frames}) > 1


def test_what_is_no_frame_is_an_error(small):
    frames = gsvx.frames(CLIP)
    for number in (len(frames), -len(frames) - 1):
        with pytest.raises(IndexError, match=f"no frame {number} of"):
            frames[number]
    clip, static = CLIP.read_bytes(), gsvx.compress_to_bytes(small)
    with pytest.raises(gsvx.Error, match="gsvx.decompress decodes it"):
        gsvx.frames(io.BytesIO(static))
    with pytest.raises(gsvx.Error, match="gsvx.frames iterates its frames"):
        gsvx.decompress(CLIP)
    with pytest.raises(gsvx.Error, match="truncated"):
        gsvx.frames(io.BytesIO(clip[:-1]))[0]
    with pytest.raises(gsvx.Error, match="limit of 3"):
        gsvx.frames(CLIP, max_gaussians=3)[0]
    with pytest.raises(ValueError, match="max_gaussians"):
        gsvx.frames(CLIP, max_gaussians=-1)
