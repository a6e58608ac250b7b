"""Import and export of .gsvx files in Blender."""

import bpy

from .operators import ExportGsvx, ImportGsvx


def _import_entry(menu, _context):
    menu.layout.operator(ImportGsvx.bl_idname, text="Gaussian splats (.gsvx)")


def _export_entry(menu, _context):
    menu.layout.operator(ExportGsvx.bl_idname, text="Gaussian splats (.gsvx)")


def register():
    bpy.utils.register_class(ImportGsvx)
    bpy.utils.register_class(ExportGsvx)
    bpy.types.TOPBAR_MT_file_import.append(_import_entry)
    bpy.types.TOPBAR_MT_file_export.append(_export_entry)


def unregister():
    bpy.types.TOPBAR_MT_file_export.remove(_export_entry)
    bpy.types.TOPBAR_MT_file_import.remove(_import_entry)
    bpy.utils.unregister_class(ExportGsvx)
    bpy.utils.unregister_class(ImportGsvx)
