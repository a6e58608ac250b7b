"""Splats as a mesh of vertices with one attribute per property, and back.

Names, values and order are those of the PLY files of 3DGS, which add-ons expect on a mesh.
"""

import re

import bpy
import numpy as np

#: Attributes of every Gaussian. Those of the other SH coefficients, f_rest_0 and so on, may be absent.
_GROUPS = {"f_dc": 3, "scale": 3, "rot": 4}


def to_mesh(name, splats):
    """A new mesh. All of it is made, or nothing."""
    mesh = bpy.data.meshes.new(name)
    try:
        mesh.vertices.add(len(splats["means"]))
        mesh.vertices.foreach_set("co", np.ravel(splats["means"]))
        for column, values in _columns(splats):
            attribute = mesh.attributes.new(column, "FLOAT", "POINT")
            attribute.data.foreach_set("value", np.ascontiguousarray(values))
        if splats.get("antialiased"):
            mesh["antialiased"] = True
        mesh.update()
    except BaseException:
        bpy.data.meshes.remove(mesh)
        raise
    return mesh


def _columns(splats):
    _, coefficients, channels = splats["shN"].shape
    for i in range(coefficients * channels):
        # All coefficients of red come first.
        yield f"f_rest_{i}", splats["shN"][:, i % coefficients, i // coefficients]
    for group, values in (("f_dc", splats["sh0"][:, 0]), ("scale", splats["scales"]), ("rot", splats["quats"])):
        yield from ((f"{group}_{i}", values[:, i]) for i in range(values.shape[1]))
    yield "opacity", splats["opacities"]


def from_mesh(mesh):
    """The splats of a mesh. Raises ValueError for one that has none."""
    if len(mesh.polygons):
        raise ValueError("it has faces, not one vertex per Gaussian; convert it to vertices first")
    rest = sum(re.fullmatch(r"f_rest_\d+", name) is not None for name in mesh.attributes.keys())
    if rest not in (0, 9, 24, 45):
        raise ValueError(f"it has {rest} attributes f_rest_*, not 0, 9, 24 or 45; import it again")
    groups = {group: _read(mesh, group, count) for group, count in {**_GROUPS, "f_rest": rest}.items()}
    n = len(mesh.vertices)
    means = np.empty(3 * n, np.float32)
    mesh.vertices.foreach_get("co", means)
    splats = {
        "means": means.reshape(n, 3),
        "scales": groups["scale"].T,
        "quats": groups["rot"].T,
        "opacities": _column(mesh, "opacity"),
        "sh0": groups["f_dc"].T[:, None],
        "shN": groups["f_rest"].reshape(3, rest // 3, n).transpose(2, 1, 0),
    }
    return {**splats, "antialiased": True} if mesh.get("antialiased") else splats


def _read(mesh, group, count):
    values = np.empty((count, len(mesh.vertices)), np.float32)
    for i in range(count):
        values[i] = _column(mesh, f"{group}_{i}")
    return values


def _column(mesh, name):
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != ("FLOAT", "POINT"):
        raise ValueError(
            f"it has no number {name} at each vertex; choose an object imported from a .gsvx file or a PLY of 3DGS"
        )
    values = np.empty(len(attribute.data), np.float32)
    attribute.data.foreach_get("value", values)
    return values
