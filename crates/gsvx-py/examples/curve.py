"""Rate and distortion of a scene: load, compress at five rates, plot the curve, look. Nothing is trained.

    pip install matplotlib
    python examples/curve.py ../../fixtures/room -o curve.png

The scene is a folder with a model and cameras. Quality is that of the held-out views against renders of
the input.
"""

# %% Load

import argparse
import time
from pathlib import Path

import matplotlib

import gsvx

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
parser.add_argument("scene", type=Path, help="folder with a model and cameras")
parser.add_argument("-o", "--output", type=Path, help="picture to write; without it, a window opens")
arguments = parser.parse_args()
if arguments.output:
    matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

model = next(iter([*arguments.scene.glob("point_cloud*.ply"), *arguments.scene.glob("*.ply")]))
splats = gsvx.read_model(model)
seen, held_out = (gsvx.read_cameras(arguments.scene, split) for split in ("train", "test"))
held_out = held_out[:8]
print(f"{model}: {len(splats['means'])} Gaussians, {model.stat().st_size / 1e6:.2f} MB")

# %% Compress at five rates

points, streams = [], []
for quality in (20, 35, 50, 65, 80):
    start = time.perf_counter()
    stream = gsvx.compress_to_bytes(splats, quality=quality, cameras=seen, drop_unseen=True)
    back = gsvx.decompress_bytes(stream)
    seconds = time.perf_counter() - start
    found = gsvx.compare(splats, back, held_out)
    points.append((len(stream) / 1e6, found.psnr))
    streams.append(back)
    size = f"{len(stream) / 1e6:6.3f} MB"
    print(f"quality {quality}: {size}, {found.psnr:.2f} dB, SSIM {found.ssim:.4f}, {seconds:.1f} s there and back")

# %% Plot the curve and look: the input, then the streams from the smallest to the largest

figure, axes = plt.subplot_mosaic(
    [["curve"] * 3, ["input", "0", "1"], ["2", "3", "4"]], figsize=(12, 10), layout="constrained"
)
axes["curve"].plot(*zip(*points), marker="o")
axes["curve"].set(xlabel="MB", ylabel="PSNR, dB from renders of the input", xscale="log")
axes["curve"].grid(alpha=0.3, which="both")
(picture,) = gsvx.render(splats, held_out[:1])
axes["input"].imshow(picture.clip(0, 1))
axes["input"].set_title("input")
for i, (back, (megabytes, psnr)) in enumerate(zip(streams, points)):
    (picture,) = gsvx.render(back, held_out[:1])
    axes[str(i)].imshow(picture.clip(0, 1))
    axes[str(i)].set_title(f"{megabytes:.3f} MB, {psnr:.1f} dB")
for name, axis in axes.items():
    if name != "curve":
        axis.axis("off")
if arguments.output:
    figure.savefig(arguments.output, dpi=110)
    print(arguments.output)
else:
    plt.show()
