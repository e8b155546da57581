"""Run in Blender, or by a Python that has its module bpy: turns a GLB of tcfit into an FBX.

    blender --background --factory-startup --python glb_to_fbx.py -- walk.glb walk.fbx 29.97
    python glb_to_fbx.py -- walk.glb walk.fbx 29.97

In the file y is up and a unit is a centimetre, without any scale in its nodes: what Unreal, Maya and Unity take as it
is. The skeleton's own root is the pelvis; the node above it is called Armature, which Unreal leaves out by that name.
Every frame has a key.

It imports nothing of tcfit, which Blender's own Python does not have.
"""

import os
import sys

import bpy  # pyright: ignore[reportMissingImports]

_CENTIMETRES = 100.0


def main(glb: str, fbx: str, frame_rate: float) -> None:
    """Read, scale and write."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    whole = max(1, round(frame_rate))
    scene.render.fps, scene.render.fps_base = whole, 1.0  # the importer of 4.2 takes a base the wrong way round
    bpy.ops.import_scene.gltf(filepath=glb)
    _onto_frames(frame_rate / whole)
    scene.render.fps_base = whole / frame_rate
    (armature,) = (thing for thing in scene.objects if thing.type == "ARMATURE")
    meshes = [thing for thing in scene.objects if thing.find_armature() == armature]
    _leave_only(scene, {armature, *meshes})
    _to_centimetres(scene, armature, meshes)
    armature.name = armature.data.name = "Armature"
    _set_frames(scene, armature)
    bpy.ops.export_scene.fbx(
        filepath=fbx,
        object_types={"ARMATURE", "MESH"},
        axis_forward="-Z",
        axis_up="Y",
        apply_unit_scale=True,
        apply_scale_options="FBX_SCALE_NONE",
        use_mesh_modifiers=False,  # it would leave out the shapes
        add_leaf_bones=False,
        armature_nodetype="NULL",
        bake_anim=True,
        bake_anim_use_all_bones=True,
        bake_anim_use_nla_strips=False,
        bake_anim_use_all_actions=False,
        bake_anim_simplify_factor=0.0,
    )


def _onto_frames(slower: float) -> None:
    """Keys where the video's frames are, by whole numbers."""
    for action in bpy.data.actions:
        for curve in action.fcurves:
            for key in curve.keyframe_points:
                for point in (key.co, key.handle_left, key.handle_right):
                    point[0] *= slower
                key.co[0] = round(key.co[0])


def _leave_only(scene: "bpy.types.Scene", kept: set) -> None:
    """Without the camera, bones' shapes and nodes that hold others, whose places stay."""
    for thing in kept:
        if thing.parent is not None and thing.parent not in kept:
            there = thing.matrix_world.copy()
            thing.parent = None
            thing.matrix_world = there
    for thing in list(bpy.data.objects):
        if thing not in kept:
            bpy.data.objects.remove(thing)


def _to_centimetres(scene: "bpy.types.Scene", armature: "bpy.types.Object", meshes: list) -> None:
    """Numbers a hundred times as large, in a unit a hundredth as long."""
    armature.scale = [_CENTIMETRES * size for size in armature.scale]
    for mesh in meshes:
        if mesh.parent is not armature:
            mesh.scale = [_CENTIMETRES * size for size in mesh.scale]
    bpy.ops.object.select_all(action="DESELECT")
    for thing in (armature, *meshes):
        thing.select_set(True)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.transform_apply(location=False, rotation=False, scale=True)
    for curve in armature.animation_data.action.fcurves:
        if curve.data_path.endswith(".location"):
            for key in curve.keyframe_points:
                for point in (key.co, key.handle_left, key.handle_right):
                    point[1] *= _CENTIMETRES
    scene.unit_settings.system = "METRIC"
    scene.unit_settings.scale_length = 1 / _CENTIMETRES


def _set_frames(scene: "bpy.types.Scene", armature: "bpy.types.Object") -> None:
    """What is baked: all frames that have keys."""
    first, last = armature.animation_data.action.frame_range
    scene.frame_start, scene.frame_end = round(first), round(last)


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :]
    main(given[0], given[1], float(given[2]))
    sys.stdout.flush()
    if not bpy.app.binary_path:
        os._exit(0)  # the module bpy 4.2.0 often crashes while Python ends
