"""File > Import and File > Export."""

import warnings
from pathlib import Path

import bpy
import gsvx
import numpy as np
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from .attributes import from_mesh, to_mesh
from .preview import add_preview
from .turning import Z_UP, turned

_FAULTS = (gsvx.Error, OSError, ValueError, MemoryError)


def _line(error, name, remedy):
    """An error as one line: what has it, what it is, what to do."""
    if isinstance(error, MemoryError):
        return f"{name}: the memory of this machine does not suffice; {remedy}"
    if isinstance(error, OSError):
        return f"{name}: {error.strerror or error}; check the path and its permissions"
    # Advice on arguments in Python does not help a user of Blender.
    text, *advice = str(error).split("; pass ")
    text = text.removeprefix("scene: ").removeprefix(f"{name}: ")
    return f"{name}: {text}; {remedy}" if advice or isinstance(error, gsvx.Error) else f"{name}: {text}"


class _Task:
    """What import and export share."""

    filter_glob: StringProperty(default="*.gsvx", options={"HIDDEN"})
    z_up: BoolProperty(
        name="Z up",
        description="Turn between the axes of trained scenes (y down, z forward) and Blender's (z up)",
        default=True,
    )

    def attempt(self, work, name, remedy):
        """Does the work; what fails becomes one line of the report, and warnings become lines."""
        try:
            with warnings.catch_warnings(record=True) as noted:
                warnings.simplefilter("always")
                work()
        except _FAULTS as error:
            self.report({"ERROR"}, _line(error, name, remedy))
            return {"CANCELLED"}
        for warning in noted:
            self.report({"WARNING"}, f"{name}: {warning.message}")
        return {"FINISHED"}


class ImportGsvx(bpy.types.Operator, _Task, ImportHelper):
    """Import a compressed 3D Gaussian splatting scene"""

    bl_idname = "import_scene.gsvx"
    bl_label = "Import .gsvx"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".gsvx"

    lod: IntProperty(
        name="Level of detail",
        description="0 is the finest. A stream that has no such level gives its coarsest",
        default=0,
        min=0,
        max=255,
    )

    def execute(self, context):
        remedy = "copy the file again, or encode the scene again"
        return self.attempt(lambda: self._load(context), self.filepath, remedy)

    def _load(self, context):
        with gsvx.open(self.filepath) as stream:
            lod = min(self.lod, stream.lods - 1)
        splats = gsvx.decompress(self.filepath, lod=lod)
        splats = turned(splats, Z_UP if self.z_up else np.eye(4))
        name = Path(self.filepath).stem
        item = bpy.data.objects.new(name, to_mesh(name, splats))
        is_shown = add_preview(item)
        context.collection.objects.link(item)
        for other in context.selected_objects:
            other.select_set(False)
        item.select_set(True)
        context.view_layer.objects.active = item
        note = "" if is_shown else "; the viewport shows points, renders show ellipsoids"
        self.report({"INFO"}, f"{name}: {len(splats['means'])} Gaussians, level of detail {lod}{note}")


class ExportGsvx(bpy.types.Operator, _Task, ExportHelper):
    """Export the active object as a compressed 3D Gaussian splatting scene"""

    bl_idname = "export_scene.gsvx"
    bl_label = "Export .gsvx"
    filename_ext = ".gsvx"

    quality: FloatProperty(
        name="Quality",
        description="0 is smallest, 100 is best",
        default=gsvx.DEFAULT_QUALITY,
        min=0,
        max=100,
    )

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type == "MESH"

    def execute(self, context):
        name = context.object.name
        return self.attempt(lambda: self._save(context), name, "correct or delete these vertices")

    def _save(self, context):
        item = context.object
        item.update_from_editmode()
        context.view_layer.update()
        matrix = np.array(item.matrix_world, np.float64)
        if self.z_up:
            matrix = Z_UP.T @ matrix
        splats = turned(from_mesh(item.data), matrix)
        report = gsvx.compress(self.filepath, splats, quality=self.quality)
        self.report({"INFO"}, f"{self.filepath}: {report.input_gaussians} Gaussians in {report.bytes} bytes")
