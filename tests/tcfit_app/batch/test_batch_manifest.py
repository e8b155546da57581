"""The list of clips: what it may say, and everything that is wrong with it, told at once."""

from dataclasses import fields
from pathlib import Path

import pytest

from fitting_core.clips.options import CameraOptions, ClipOptions
from fitting_core.config.schema import PRESETS
from fitting_core.config.settings import settings
from fitting_core.errors import InputError
from tcfit_app.batch.columns import columns, find
from tcfit_app.batch.inputs import inputs_of, missing_input, unchanged
from tcfit_app.batch.manifest import ClipTask, Complaints, read_manifest
from tcfit_app.cli.main import parse
from tcfit_app.options.batch import BatchOptions
from tcfit_app.options.fit import SHORTCUTS, BodyOptions, StartOptions, ViewOptions
from tcfit_app.options.removed import SETTINGS
from tests.samples.media import write_video


def tasks_of(folder: Path, text: str, *options: str) -> tuple[ClipTask, ...]:
    """The clips of a list, which must be right."""
    complaints = Complaints(folder / "clips.csv")
    tasks = _read(folder, text, complaints, *options)
    complaints.raise_any()
    return tasks


def _read(folder: Path, text: str, complaints: Complaints, *options: str) -> tuple[ClipTask, ...]:
    (folder / "clips.csv").write_text(text, encoding="utf-8")
    given = parse(["batch", str(folder / "clips.csv"), *options])
    assert isinstance(given, BatchOptions)
    return read_manifest(given, complaints)


def complaints_of(folder: Path, text: str, *options: str) -> str:
    complaints = Complaints(folder / "clips.csv")
    _read(folder, text, complaints, *options)
    with pytest.raises(InputError) as refused:
        complaints.raise_any()
    return str(refused.value)


def test_every_column_has_its_effect(tmp_path: Path):
    cells = {
        "video": "a.mp4", "keypoints": "k", "out": "o", "detector": "dwpose-l",
        "person": "1", "first_frame": "3", "last_frame": "9",
        "frame_rate": "25", "keypoint_scale": "0..1", "image_size": "640x480", "focal_length": "900",
        "other_view": "b.mp4", "other_keypoints": "kb", "other_focal_length": "auto", "other_person": "1",
        "other_first_frame": "4", "center": "320 240.5",
        "body_model": "smplh", "models": "m", "gender": "male", "preset": "paper",
        "start": "s.pt", "start_person": "2", "start_first_frame": "7", "start_deviation": "0.2",
        "solver": "lbfgs", "Temporal-Weight": "300", "temporal.space": "camera", "weights.shape": '"1,2,3,4,5"',
    }  # fmt: skip
    (task,) = tasks_of(tmp_path, ",".join(cells) + "\n" + ",".join(cells.values()) + "\n")
    assert (task.fit.video, task.fit.keypoints, task.out) == tuple(tmp_path / name for name in ("a.mp4", "k", "o"))
    assert task.fit.clip == ClipOptions(
        detector="dwpose-l",
        person=1,
        first_frame=3,
        last_frame=9,
        frame_rate=25.0,
        keypoint_scale="0..1",
        image_size=(640, 480),
    )
    assert task.fit.camera == CameraOptions(focal_length=900.0, center=(320.0, 240.5))
    assert task.fit.views == ViewOptions(
        other_view=(tmp_path / "b.mp4",),
        other_keypoints=(tmp_path / "kb",),
        other_focal_length=("auto",),
        other_person=(1,),
        other_first_frame=(4,),
    )
    assert task.fit.body == BodyOptions(body_model="smplh", models=tmp_path / "m", gender="male")
    assert task.fit.begin == StartOptions(start=tmp_path / "s.pt", start_person=2, start_first_frame=7)
    assert task.config.start_deviation == 0.2
    assert (task.config.solver, task.config.temporal.weight, task.config.temporal.space) == ("lbfgs", 300.0, "camera")
    assert task.config.weights.shape == (1, 2, 3, 4, 5) and task.line == 2
    assert task.config.weights.body_pose == PRESETS["paper"].weights.body_pose


def test_another_view_is_input_of_a_clip(tmp_path: Path):
    header = "video,keypoints,out,other_view,other_keypoints,other_person\n"
    text = header + "a.mp4,k.json,a,b.mp4,kb.json,\na.mp4,k.json,b,,,\n"
    for name in ("a.mp4", "b.mp4", "k.json", "kb.json"):
        (tmp_path / name).write_text(name)
    both, alone = tasks_of(tmp_path, text)
    (other,) = tasks_of(tmp_path, header + "a.mp4,k.json,a,b.mp4,kb.json,1\n")
    before = inputs_of(both)
    assert inputs_of(tasks_of(tmp_path, text)[0]) == before and len({before, inputs_of(alone), inputs_of(other)}) == 3
    (tmp_path / "b.mp4").write_text("another")
    assert not unchanged(before, both)
    (tmp_path / "b.mp4").unlink()
    assert missing_input(both) == [("other_view", tmp_path / "b.mp4")] and unchanged(before, both)


def test_every_option_of_a_clip_is_a_column():
    options = {
        f.name for kind in (ClipOptions, CameraOptions, ViewOptions, BodyOptions, StartOptions) for f in fields(kind)
    }
    own = {"video", "keypoints", "out", "shape", "preset", "part_minutes"}
    assert options | set(SHORTCUTS) | set(SETTINGS) | own == set(columns())
    assert all(find(name) for name in settings())


def test_empty_cells_take_what_the_command_line_says(tmp_path: Path):
    text = "keypoints,out,fov,preset,window_size\nk1,o1,,,\nk2,o2,50,paper,9\n"
    one, two = tasks_of(tmp_path, text, "--focal-length", "700", "--gender", "female", "--set", "hip_weight=0.5")
    assert one.fit.camera.focal_length == 700 and one.config.temporal.mode == "global"
    assert two.fit.camera == CameraOptions(fov=50.0)  # and not the focal length as well
    assert two.config.temporal.window_size == 9 and two.config.temporal.mode == "sliding_window"
    assert {t.fit.body.gender for t in (one, two)} == {"female"} and {t.config.hip_weight for t in (one, two)} == {0.5}


def test_a_clip_has_one_camera_the_list_s_before_the_command_line_s(tmp_path: Path):
    text = "keypoints,out,camera,camera_name,camera_up,fov\nk,a,Calib.toml,left,z,\nk,b,,,,50\nk,c,,right,,\n"
    line = ("--camera", "other.npz", "--camera-name", "mine", "--camera-unit", "0.001")
    one, two, three = (task.fit.camera for task in tasks_of(tmp_path, text, *line))
    assert one == CameraOptions(camera=tmp_path / "Calib.toml", camera_name="left", camera_unit=0.001, camera_up="z")
    assert two == CameraOptions(fov=50.0)
    assert three == CameraOptions(camera=Path("other.npz"), camera_name="right", camera_unit=0.001)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_spreadsheets_of_all_countries_are_read(tmp_path: Path, delimiter: str):
    lines = ["\ufeffkeypoints,out,center", 'k,"a, b",3 4', "", "k,  c ,"]
    text = "\r\n".join(line.replace(",", delimiter) for line in lines)
    tasks = tasks_of(tmp_path, text)
    assert [(t.line, t.name) for t in tasks] == [(2, f"a{delimiter} b"), (4, "c")]
    assert tasks[0].fit.camera.center == (3.0, 4.0)


def test_a_focal_length_that_is_not_given_goes_by_the_preset(tmp_path: Path):
    text = "keypoints,out,preset,focal_length\nk,a,,\nk,b,paper,\nk,c,paper,auto\nk,d,,diagonal\nk,e,,800\n"
    found = [task.fit.camera.focal_length for task in tasks_of(tmp_path, text)]
    assert found == [None, "diagonal", "auto", "diagonal", 800]


WRONG = {
    "keypoints,out,other_person,other_first_frame\nk,o,1,-1\n": [
        "line 2, column other_first_frame: is -1; expected a whole number or auto, 0 or more",
        "column other_view: other_person without other_view; give the other video",
    ],
    "keypoint,out\nk,o\n": [
        "line 1: there is no column 'keypoint'; did you mean keypoints",
        "both columns video and keypoints are missing",
    ],
    "keypoints,out,out\nk,o,p\n": ["line 1: the column out occurs 2 times"],
    "keypoints\nk\n": ["line 1: the column out is missing"],
    "keypoints,out,\nk,o,\n": ["line 1: a column has no name"],
    "keypoints,out\nk\n": ["line 2: has 1 cells; expected 2"],
    "keypoints,out\nk,\n,o\n": ["line 2, column out: is empty", "line 3: has neither a video nor keypoints"],
    "keypoints,out\nk,o\nk,./x/../o\n": ["line 3, column out: ./x/../o is already the folder of line 2"],
    "keypoints,out\nk,o/p\nk,o\n": ["line 2, column out: o/p is inside the folder of line 3"],
    "keypoints,out,person\nk,o,one\nk,p,-1\n": [
        "column person: is 'one'; expected a whole number",
        "0 or more",
    ],
    "keypoints,out,fov\nk,o,200\nk,p,nan\n": ["line 2, column fov: is 200", "line 3, column fov: is nan"],
    "keypoints,out,image_size\nk,o,640\n": ["column image_size: is '640'; expected two whole numbers such as 640x480"],
    "keypoints,out,focal_length\nk,o,long\nk,p,-5\n": [
        "line 2, column focal_length: is 'long'; expected a number, auto or diagonal",
        "line 3, column focal_length: is -5; expected a number, auto or diagonal, above 0",
    ],
    "keypoints,out,fov,focal_length\nk,o,50,900\n": ["given 2 times, by focal_length, fov"],
    "keypoints,out,fov,camera\nk,o,50,c.npz\n": ["given 2 times, by fov, camera"],
    "keypoints,out,camera,camera_up\nk,o,c.npz,north\n": ["column camera_up: is 'north'; expected one of x, y, z, -x"],
    "keypoints,out,first_frame,last_frame\nk,o,5,4\n": ["first_frame 5 lies behind last_frame 4"],
    "keypoints,out,start_person\nk,o,2\n": ["line 2, column start: start_person without start; give the result"],
    "keypoints,out,gender\nk,o,man\n": ["column gender: is 'man'; expected one of neutral, male, female"],
    "keypoints,out,preset\nk,o,papre\n": ["column preset: is 'papre'; expected one of smplifyx, paper, tcfit"],
    "keypoints,out,window_size\nk,o,1\n": ["line 2: window_size: temporal.window_size is 1; expected 2 or more"],
    "keypoints,out,subject\nk,o,anna\n": ["line 1: the column subject was removed; fit one of its clips"],
    "keypoints,out,shape,height\nk,o,s.npz,172\n": ["line 2: has both a known shape and a height"],
    "keypoints,out,solver\nk,o,newton\n": ["line 2: solver: solver is newton; expected one of lm, lbfgs"],
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_is_told_with_line_and_column(tmp_path: Path, text: str):
    message = complaints_of(tmp_path, text)
    assert message.startswith(f"{tmp_path / 'clips.csv'} has ") and "nothing was started" in message
    for part in WRONG[text]:
        assert part in message


def test_all_errors_are_told_at_once_by_line(tmp_path: Path):
    rows = "".join(f"k,o{i},x\n" for i in range(50))
    message = complaints_of(tmp_path, "keypoints,out,person\nk,,1\n" + rows)
    assert "has 51 errors" in message and message.splitlines()[1].startswith("  line 2, column out")
    assert "  line 3, column person" in message and message.splitlines()[-1] == "  ... and 21 more"


@pytest.mark.parametrize("content", [b"", b"keypoints,out\n", b"\xff\xfe\x00k", b'keypoints,out\n"k,o\n'])
def test_what_is_no_list_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "clips.csv").write_bytes(content)
    options = BatchOptions(manifest=tmp_path / "clips.csv")
    with pytest.raises(InputError, match=r"lists no clips|is not a CSV file"):
        read_manifest(options, Complaints(options.manifest))
    with pytest.raises(InputError, match="is a folder, expected a file"):
        read_manifest(BatchOptions(manifest=tmp_path), Complaints(tmp_path))
    with pytest.raises(InputError, match="cannot be read"):
        read_manifest(BatchOptions(manifest=tmp_path / "none.csv"), Complaints(tmp_path))


@pytest.fixture
def filmed(tmp_path: Path) -> Path:
    """A folder with a video of 14 frames, which a list takes for 14 seconds."""
    write_video(tmp_path / "day.avi", frames=14)
    return tmp_path


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("", [(0, 4, "00-00-00"), (5, 8, "00-00-05"), (9, 13, "00-00-09")]),
        ("2,11", [(2, 6, "00-00-02"), (7, 11, "00-00-07")]),
    ],
)
def test_long_clip_is_divided_into_equal_parts(filmed: Path, more: str, expected: list[tuple[int, int, str]]):
    header = "video,out,frame_rate,part_minutes" + ",first_frame,last_frame" * bool(more)
    parts = tasks_of(filmed, f"{header}\nday.avi,fits/day,1,0.1{more and ','}{more}\n")
    found = [(task.fit.clip.first_frame, task.fit.clip.last_frame, task.out.name) for task in parts]
    assert found == expected and {task.out.parent for task in parts} == {filmed / "fits/day"}


def test_short_clip_has_no_parts_and_a_cell_overrides_the_option(filmed: Path):
    (task,) = tasks_of(filmed, "video,out,frame_rate,part_minutes\nday.avi,o,1,1\n", "--part-minutes", "0.1")
    assert task.out == filmed / "o"


def test_parts_need_a_video_and_some_length(filmed: Path):
    told = complaints_of(filmed, "video,keypoints,out,part_minutes\n,k,a,5\nday.avi,,b,0\nnone.mp4,,c,5\n")
    assert "line 2, column part_minutes: needs a video" in told
    assert "line 3, column part_minutes: is 0; expected a number, 0.1 or more" in told
    assert "line 4, column part_minutes" in told and "none.mp4" in told
