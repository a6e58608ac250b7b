"""Steps per second of gsplat and torch's Adam. Arguments: a folder of arrays, pixels of a side."""
import sys
import time

import numpy as np
import torch
from gsplat import rasterization

folder, side = sys.argv[1], int(sys.argv[2])


def load(name, *shape):
    array = np.fromfile(f"{folder}/{name}", dtype="<f4").reshape(shape)
    return torch.from_numpy(array).cuda()


moved = {
    "quats": load("quats", -1, 4),
    "scales": load("scales", -1, 3),
    "opacities": load("opacities", -1),
    "sh": load("sh", len(np.fromfile(f"{folder}/opacities", dtype="<f4")), -1, 3),
}
means, photo = load("means", -1, 3), load("photo", side, side, 3)
pose = torch.eye(4, device="cuda")
pose[:3] = load("pose", 3, 4)
fx, fy, cx, cy = load("lens", 4).tolist()
lens = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], device="cuda")
for value in moved.values():
    value.requires_grad_()
adam = torch.optim.Adam(moved.values(), lr=1e-3)


def step():
    image, _, _ = rasterization(
        means, moved["quats"], moved["scales"].exp(), moved["opacities"].sigmoid(), moved["sh"],
        pose[None], lens[None], side, side, sh_degree=3,
    )
    adam.zero_grad()
    ((image[0] - photo) ** 2).mean().backward()
    adam.step()


for _ in range(3):
    step()
torch.cuda.synchronize()
count, started = 0, time.monotonic()
while time.monotonic() - started < 10:
    for _ in range(5):
        step()
    torch.cuda.synchronize()
    count += 5
print(count / (time.monotonic() - started))
