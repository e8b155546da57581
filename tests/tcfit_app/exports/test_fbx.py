"""FBX by Blender: with a program in its place for whatever may go wrong, and with Blender itself where it is."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting_core.body.model import JOINTS, BodyModel
from fitting_core.errors import InputError
from fitting_core.files.locking import locked
from tcfit_app.cli.main import main
from tcfit_app.exports.blender import running
from tcfit_app.exports.exporting import write_export
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import EXPORTS
from tests.drivers.waiting import until
from tests.fitting_core.io.motion.motions import meshes, swinging
from tests.tcfit_app.conftest import FinishedRun

FAKE = Callable[[str], None]


@pytest.fixture
def blender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FAKE:
    """Puts a program named blender on the PATH, of these lines of Python: `glb` and `fbx` are the files it is given."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))

    def make(lines: str) -> None:
        program = folder / "blender"
        given = "import os, sys, time, pathlib\nglb, fbx, rate = sys.argv[sys.argv.index('--') + 1:]\n"
        program.write_text(f"#!{sys.executable}\n{given}{lines}\n")
        program.chmod(0o755)

    return make


@pytest.fixture
def source(tiny_body: BodyModel) -> ExportSource:
    return ExportSource(name="swing", known_motion=swinging(tiny_body))


def written(source: ExportSource, folder: Path, progress: Callable[[float], None] = lambda share: None) -> bytes:
    write_export(EXPORTS["fbx"], source, folder / "swing.fbx", progress, zipped=False)
    return (folder / "swing.fbx").read_bytes()


def test_blender_gets_the_character_and_its_frame_rate(blender: FAKE, source: ExportSource, tmp_path: Path):
    blender(
        "told = rate.encode() + ' '.join(sys.argv[1:5]).encode()\n"
        "pathlib.Path(fbx).write_bytes(pathlib.Path(glb).read_bytes()[:4] + told)"
    )
    said = written(source, tmp_path)
    assert said.startswith(b"glTF29.97--background --factory-startup --python-exit-code 1")


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("print('no such addon: gltf'); sys.exit(3)", "exit code 3.*no such addon: gltf"),
        ("print('done')", "wrote no FBX.*done"),
        ("pathlib.Path(fbx).write_bytes(b'half'); os.abort()", "exit code -6"),
        ("pathlib.Path(fbx).write_bytes(b'half'); time.sleep(60)", "has not ended after 0 s"),
    ],
)
def test_what_goes_wrong_in_blender_is_told(
    blender: FAKE, source: ExportSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: str, said: str
):
    monkeypatch.setattr(running, "_LONGEST", 0.3 if "sleep" in lines else 60.0)
    monkeypatch.setattr(running, "_PER_FRAME", 0.0)
    blender(lines)
    with pytest.raises(InputError, match=f"(?s){said}"):
        written(source, tmp_path)
    assert not list(tmp_path.glob("*.fbx*")) and not list(tmp_path.glob(".*"))


def test_a_cancelled_export_ends_blender(blender: FAKE, source: ExportSource, tmp_path: Path):
    blender(f"pathlib.Path({str(tmp_path)!r}, 'pid').write_text(str(os.getpid())); time.sleep(60)")
    pid = tmp_path / "pid"

    def stop(share: float) -> None:
        if pid.exists() and pid.read_text():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written(source, tmp_path, stop)
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin", "pid"]


def test_what_a_script_named_blender_has_started_is_ended_too(blender: FAKE, source: ExportSource, tmp_path: Path):
    lock, begun = tmp_path / "lock", tmp_path / "begun"
    program = (
        f"import pathlib, time; from fitting_core.files.locking import locked; locked(pathlib.Path({str(lock)!r})); "
    )
    program += f"pathlib.Path({str(begun)!r}).touch(); time.sleep(60)"
    blender(f"import subprocess; subprocess.run([sys.executable, '-c', {program!r}])")

    def stop(share: float) -> None:
        if begun.exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written(source, tmp_path, stop)
    os.close(until(lambda: locked(lock), "the end of what the script has started"))


def test_without_blender_it_is_said_what_to_install(
    finished: FinishedRun, source: ExportSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(running.importlib.util, "find_spec", lambda name: None)
    assert "pip install bpy" in EXPORTS["fbx"].missing()
    assert main(["export", str(finished.folder), "--formats", "glb", "fbx", "--out", str(tmp_path / "o")]) == 2
    assert "Install Blender" in capsys.readouterr().err and not (tmp_path / "o").exists()
    with pytest.raises(InputError, match="Install Blender"):
        written(source, tmp_path)


_READ = """
import bpy, json, os, sys
fbx, out, frames, names = sys.argv[sys.argv.index("--") + 1], sys.argv[-1], (0, 3, 6), {names!r}
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.fbx(filepath=fbx, anim_offset=0.0)
from io_scene_fbx import parse_fbx
root, _ = parse_fbx.parse(fbx)
inside = lambda element, name: [e for e in element.elems if e and e.id == name]
settings = inside(inside(root, b"GlobalSettings")[0], b"Properties70")[0]
said = {{p.props[0].decode(): p.props[4] for p in settings.elems if p.props[0].endswith((b"Axis", b"Factor"))}}
scene = bpy.context.scene
(armature,) = [o for o in scene.objects if o.type == "ARMATURE"]
(mesh,) = [o for o in scene.objects if o.type == "MESH"]
joints, vertices = [], []
for frame in frames:
    at = frame * scene.render.fps_base  # the importer of 4.2 puts keys at seconds times fps, without its base
    scene.frame_set(int(at), subframe=at % 1)
    joints.append([list(armature.matrix_world @ armature.pose.bones[name].head) for name in names])
    shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    vertices.append([list(shown.matrix_world @ v.co) for v in shown.to_mesh().vertices])
found = dict(
    settings=said, joints=joints, vertices=vertices, rate=scene.render.fps / scene.render.fps_base,
    scale=list(armature.scale),
    roots=[bone.name for bone in armature.data.bones if bone.parent is None], bones=len(armature.data.bones),
    objects=sorted(o.name for o in scene.objects), shapes=[k.name for k in mesh.data.shape_keys.key_blocks],
    end=armature.animation_data.action.frame_range[1] / scene.render.fps_base,
)
open(out, "w").write(json.dumps(found))
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.skipif(bool(running.missing()), reason="neither blender on the PATH nor the module bpy is here")
def test_blender_reads_back_what_the_fit_is(free_body: BodyModel, tmp_path: Path):
    motion = swinging(free_body)
    begun = time.monotonic()
    written(ExportSource(name="swing", known_motion=motion), tmp_path)
    assert time.monotonic() - begun < 120
    (tmp_path / "read.py").write_text(_READ.format(names=list(JOINTS)))
    out = tmp_path / "found.json"
    command = [*running._command(), str(tmp_path / "read.py"), "--", str(tmp_path / "swing.fbx"), str(out)]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    found = json.loads(out.read_text())
    # Its world has z up.
    upright = motion.in_axes("y-up")
    joints, vertices = (np.array(found[name])[..., [0, 2, 1]] * (1, 1, -1) for name in ("joints", "vertices"))
    assert np.linalg.norm(joints - upright.joints()[[0, 3, 6]], axis=-1).max() < 1e-3
    assert np.linalg.norm(vertices - meshes(upright)[[0, 3, 6]], axis=-1).max() < 1e-3
    assert found["settings"]["UpAxis"] == 1 and found["settings"]["UnitScaleFactor"] == 1.0
    np.testing.assert_allclose(found["scale"], 0.01, rtol=1e-6)  # of centimetres, seen in metres: none in the file
    assert found["roots"] == ["pelvis"] and found["bones"] == 55 and found["objects"] == ["Armature", "body"]
    assert (
        "expression_0" in found["shapes"]
        and found["end"] == pytest.approx(6, abs=1e-4)
        and found["rate"] == pytest.approx(29.97)
    )
