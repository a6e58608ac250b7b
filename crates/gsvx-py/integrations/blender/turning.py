"""Splats in other axes: turned, scaled and moved, with their spherical harmonics."""

import numpy as np

#: From the axes of streams (x to the right, y down, z forward) to Blender's (y forward, z up).
Z_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)


def turned(splats, matrix):
    """The splats under a 4 by 4 matrix. Raises ValueError if it does more than turn, scale and move."""
    if np.array_equal(matrix, np.eye(4)):
        return splats
    scale, rotation = _parts(matrix[:3, :3])
    means = splats["means"] @ matrix[:3, :3].T + matrix[:3, 3]
    sh = _sh_rotation(rotation, splats["shN"].shape[1]).astype(np.float32)
    turned = {
        "means": means,
        "scales": splats["scales"] + np.log(scale),
        "quats": splats["quats"] @ _product(_quaternion(rotation)).T,
        "opacities": splats["opacities"],
        "sh0": splats["sh0"],
        "shN": np.tensordot(sh, splats["shN"], (1, 1)).transpose(1, 0, 2),
    }
    return {**splats, **{name: array.astype(np.float32, copy=False) for name, array in turned.items()}}


def _parts(linear):
    """Scale and rotation of a 3 by 3 matrix."""
    scale = np.cbrt(np.linalg.det(linear))
    if not scale > 0:
        raise ValueError("its transform mirrors; make all scales positive")
    rotation = linear / scale
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-4:
        raise ValueError("its scale differs along x, y and z; make it the same")
    return scale, rotation


def _quaternion(rotation):
    """The quaternion w x y z of a rotation: the eigenvector of a symmetric matrix (Bar-Itzhack)."""
    r = rotation
    k = np.array(
        [
            [np.trace(r), r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0, 0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [0, 0, 0, r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    quaternion = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return quaternion if quaternion[0] >= 0 else -quaternion


def _product(quaternion):
    """The matrix that multiplies by a quaternion from the left."""
    w, x, y, z = quaternion
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def _sh_rotation(rotation, coefficients):
    """What turns SH coefficients of degrees 1 to 3: colours seen along rotated directions are the old ones."""
    i = np.arange(64) + 0.5
    z = 1 - i / 32
    angle = i * np.pi * (1 + np.sqrt(5))
    r = np.sqrt(1 - z * z)
    directions = np.stack([r * np.cos(angle), r * np.sin(angle), z], 1)
    matrix = np.zeros((coefficients, coefficients))
    for low, high in ((0, 3), (3, 8), (8, 15)):
        if high <= coefficients:
            new, old = (_basis(d)[:, low:high] for d in (directions, directions @ rotation))
            matrix[low:high, low:high] = np.linalg.lstsq(new, old, rcond=None)[0]
    # Turns by right angles have many zeros.
    return np.where(np.abs(matrix) < 1e-9, 0, matrix)


def _basis(directions):
    """Spherical harmonics of degrees 1 to 3, with the signs of 3DGS."""
    x, y, z = directions.T
    xx, yy, zz = x * x, y * y, z * z
    columns = [
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * zz - xx - yy),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644658 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return np.stack(columns, 1)
