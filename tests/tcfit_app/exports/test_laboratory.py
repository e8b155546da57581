"""Exports for laboratories, read again by programs that have nothing to do with those that wrote them."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from fitting_core.body.markers.joint_centres import CENTRES, joint_centres_in_space
from fitting_core.body.markers.marker_set import STANDARD, marker_places
from fitting_core.body.markers.places import PLACES
from fitting_core.body.mesh import Mesh
from fitting_core.body.model import JOINT, JOINTS, BodyModel
from fitting_core.camera import World, path_of
from fitting_core.errors import InputError
from fitting_core.ground.contacts import Contacts
from fitting_core.ground.level import level_of
from fitting_core.measure.references.files import read_reference
from fitting_core.motion import AXES, OWN_WORLD, Motion
from fitting_core.results.error_bars import ANGLES
from tcfit_app.exports.exporting import content_of
from tcfit_app.exports.source import ExportSource
from tcfit_app.exports.table import EXPORTS
from tests.fitting_core.io.motion.motions import swinging
from tests.samples.project_samples import sample_error_bars

FRAMES = 7
STANDING = np.array([[0, 0], [1, 0], [1, 0], [1, 1], [0, 1], [0, 0], [0, 1]], bool)
SEEN = np.array([[1, 1], [1, 1], [1, 1], [1, 1], [1, 1], [1, 0], [1, 1]], float)
CONTACTS = Contacts(probability=SEEN, standing=STANDING, let_go=np.zeros_like(STANDING))
"""Left: strikes in the second frame, off in the fifth. Right: strikes in the fourth; goes out of sight, comes back."""


@pytest.fixture(scope="module")
def moving(free_body: BodyModel) -> Motion:
    """Frames 12 to 18 of a video at 29.97 per second."""
    return replace(swinging(free_body, FRAMES), contacts=CONTACTS)


POINTS = (*JOINTS, *CENTRES)


def points(motion: Motion) -> np.ndarray:
    """Joints and joint centres in the motion's world, metres."""
    return np.concatenate([motion.joints(), joint_centres_in_space(motion.body, motion.params)], 1)


def exported(motion: Motion, name: str, folder: Path, **choices) -> Path:
    source = ExportSource(name=motion.name, known_motion=motion, **choices)
    path = folder / f"out{EXPORTS[name].suffix}"
    path.write_bytes(content_of(EXPORTS[name], source, lambda share: None)[0])
    return path


def parsed_trc(path: Path) -> tuple[list[str], np.ndarray, np.ndarray, dict[str, str]]:
    """Names, times and places (T, N, 3) in the file's unit, by the words of OpenSim's documentation alone."""
    lines = path.read_text().split("\n")
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    header = dict(zip(keys, values, strict=True))
    names = lines[3].split("\t")[2::3]
    rows = np.array([[float(cell) for cell in line.split("\t")] for line in lines[5:] if line])
    assert lines[0].startswith("PathFileType\t4\t(X/Y/Z)\t")
    assert [int(header[key]) for key in ("NumFrames", "NumMarkers")] == [len(rows), len(names)]
    assert len(lines[4].split("\t")) == 2 + 3 * len(names) and rows.shape[1] == 2 + 3 * len(names)
    return names, rows[:, 1], rows[:, 2:].reshape(len(rows), -1, 3), header


def test_tables_have_error_bars_where_they_are_known(moving: Motion, tmp_path: Path):
    bars = sample_error_bars(3, FRAMES)
    barred = replace(moving, error_bars=bars)
    for name, column, values in (
        ("joints", "left_knee_error_bar_along", bars.joints[:, JOINT["left_knee"], 0]),
        ("joints", "right_wrist_error_bar_across", bars.joints[:, JOINT["right_wrist"], 1]),
        ("angles", "right_elbow_flexion_error_bar", bars.angles[:, ANGLES.index("right_elbow_flexion")]),
    ):
        for motion, expected in ((barred, values), (moving, np.full(FRAMES, np.nan))):
            lines = [line for line in exported(motion, name, tmp_path).read_text().splitlines() if line[0] != "#"]
            cells = [row[column] for row in csv.DictReader(lines)]
            np.testing.assert_allclose([float(cell or "nan") for cell in cells], expected, atol=1e-4)


def test_the_table_of_joints_is_where_they_are(moving: Motion, tmp_path: Path):
    lines = exported(moving, "joints", tmp_path).read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if line[0] != "#"))
    assert [int(row["frame"]) for row in rows] == list(range(12, 12 + FRAMES))
    places = [[float(row[f"head_{axis}"]) for axis in "xyz"] for row in rows]
    np.testing.assert_allclose(places, moving.in_axes("y-up").joints()[:, JOINT["head"]], atol=1e-4)


def y_up(places: np.ndarray) -> np.ndarray:
    return places * (1, -1, -1)


def z_up(places: np.ndarray) -> np.ndarray:
    return np.stack([places[..., 0], places[..., 2], -places[..., 1]], -1)


def test_joints_as_trc(moving: Motion, tmp_path: Path):
    names, times, places, header = parsed_trc(exported(moving, "trc", tmp_path))
    assert names == list(POINTS) and header["Units"] == "mm" and float(header["DataRate"]) == pytest.approx(29.97)
    np.testing.assert_allclose(times, (12 + np.arange(FRAMES)) / 29.97, atol=1e-5)
    np.testing.assert_allclose(places, 1e3 * y_up(points(moving)), atol=0.01)


def on_the_skin(motion: Motion, name: str, vertex: int, radius: float) -> np.ndarray:
    """Millimetres in camera space: the vertex, and off it along the sum of the triangles around."""
    faces = motion.body.faces[(motion.body.faces == vertex).any(1)]
    found = []
    for vertices in Mesh(motion.body)(motion.params).numpy().astype(float):
        normal = sum(np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a]) for a, b, c in faces)
        found.append(1e3 * (vertices[vertex] + radius * normal / np.linalg.norm(normal)))
    return np.array(found)


def test_markers_as_trc(moving: Motion, tmp_path: Path):
    from fitting_core.body.markers.places import standard_vertices

    names, _, places, _ = parsed_trc(exported(moving, "trc-markers", tmp_path))
    assert names == list(PLACES)
    for name in ("LKNE", "RFHD", "T10"):
        expected = on_the_skin(moving, name, standard_vertices(moving.body)[name], 0.007)
        np.testing.assert_allclose(places[:, names.index(name)], y_up(expected), atol=0.05)


def test_everything_as_c3d_read_by_another_library(moving: Motion, tmp_path: Path):
    read = ezc3d.c3d(str(exported(moving, "c3d", tmp_path)))
    point, event = read["parameters"]["POINT"], read["parameters"]["EVENT"]
    labels = point["LABELS"]["value"]
    assert labels == [*PLACES, *POINTS] and point["UNITS"]["value"] == ["mm"]
    assert point["RATE"]["value"][0] == pytest.approx(29.97) and point["X_SCREEN"]["value"] == ["+X"]
    assert point["Y_SCREEN"]["value"] == ["+Z"]
    header = read["header"]["points"]
    assert (header["first_frame"], header["last_frame"]) == (12, 18), "ezc3d counts from 0"
    places = read["data"]["points"][:3].transpose(2, 1, 0)
    np.testing.assert_allclose(places[:, len(PLACES) :], 1e3 * z_up(points(moving)), atol=0.01)
    _, _, markers, _ = parsed_trc(exported(moving, "trc-markers", tmp_path))
    upright = np.stack([markers[..., 0], -markers[..., 2], markers[..., 1]], -1)
    np.testing.assert_allclose(places[:, : len(PLACES)], upright, atol=0.01)
    happened = list(
        zip(event["CONTEXTS"]["value"], event["LABELS"]["value"], event["TIMES"]["value"].T.tolist(), strict=True)
    )
    assert [(side, label) for side, label, _ in happened] == [
        ("Left", "Foot Strike"),
        ("Right", "Foot Strike"),
        ("Left", "Foot Off"),
    ]
    assert [60 * minutes + seconds for _, _, (minutes, seconds) in happened] == pytest.approx(
        [13 / 29.97, 15 / 29.97, 16 / 29.97]
    )


def test_contacts_say_how_they_begin_and_end(moving: Motion, tmp_path: Path):
    rows = list(csv.DictReader(exported(moving, "contacts", tmp_path).open()))
    assert [(row["side"], row["first_frame"], row["last_frame"]) for row in rows] == [
        ("left", "13", "15"),
        ("right", "15", "16"),
        ("right", "18", "18"),
    ]
    assert float(rows[0]["begin_seconds"]) == pytest.approx(13 / 29.97, abs=1e-4)
    assert float(rows[0]["end_seconds"]) == pytest.approx(16 / 29.97, abs=1e-4)
    assert [(row["begins_with"], row["ends_with"]) for row in rows] == [
        ("foot strike", "foot off"),
        ("foot strike", "leaves the view"),
        ("comes into view", "last frame"),
    ]


def test_without_contacts_there_is_a_c3d_without_events(moving: Motion, tmp_path: Path):
    unknown = replace(moving, contacts=None)
    read = ezc3d.c3d(str(exported(unknown, "c3d", tmp_path)))
    assert read["parameters"]["EVENT"]["USED"]["value"][0] == 0
    with pytest.raises(InputError, match="not known which foot stands"):
        exported(unknown, "contacts", tmp_path)


def test_axes_are_obeyed(moving: Motion, tmp_path: Path):
    turn = ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0))
    there = World(rotation=turn, translation=(0.1, 1.5, 4.0), up="z")
    placed = replace(moving, camera=replace(moving.camera, world=there))
    of_laboratory = (points(moving) - there.translation) @ np.array(turn)
    for axes, expected, up in (("camera", points(moving), "-Y"), ("world", of_laboratory, "+Z")):
        _, _, places, _ = parsed_trc(exported(placed, "trc", tmp_path, axes=axes))
        np.testing.assert_allclose(places, 1e3 * expected, atol=0.01)
        read = ezc3d.c3d(str(exported(placed, "c3d", tmp_path, axes=axes)))
        assert read["parameters"]["POINT"]["Y_SCREEN"]["value"] == [up]
        np.testing.assert_allclose(
            read["data"]["points"][:3, len(PLACES) :].transpose(2, 1, 0), 1e3 * expected, atol=0.01
        )


LABORATORY = World(rotation=((1, 0, 0), (0, 0, -1), (0, 1, 0)), translation=(0.1, 1.5, 4.0), up="z")


@pytest.mark.parametrize("axes", [None, *AXES, OWN_WORLD])
@pytest.mark.parametrize("name", ["trc", "trc-markers", "c3d", "npz"])
def test_what_is_exported_comes_back_before_the_camera(moving: Motion, tmp_path: Path, name: str, axes: str | None):
    """Whatever its axes, and whatever world the clip's calibration has."""
    placed = replace(moving, camera=replace(moving.camera, world=LABORATORY), level=level_of(None, LABORATORY))
    path = exported(placed, name, tmp_path, axes=axes)
    found = read_reference(path, seen_by=placed.camera)
    assert found.in_camera and not any("calibration" in note for note in found.notes)
    if found.markers is None:
        assert found.joints is not None
        np.testing.assert_allclose(found.joints, moving.joints(), atol=2e-6)
        return
    places = dict(zip(found.markers.names, found.all_points[:, -len(found.markers) :].swapaxes(0, 1), strict=True))
    expected = dict(zip(POINTS, points(moving).swapaxes(0, 1), strict=True))
    on_skin = marker_places(moving.body, moving.params, STANDARD)
    expected |= dict(zip(STANDARD.names, on_skin.swapaxes(0, 1), strict=True))
    assert len(places) >= len(STANDARD)
    for point, place in places.items():
        np.testing.assert_allclose(place, expected[point], atol=2e-6)


def test_of_a_camera_that_moves_no_place_is_written(moving: Motion, tmp_path: Path):
    turns, places = np.tile(np.eye(3), (FRAMES, 1, 1)), np.linspace((0, 0, 0), (0.1, 0, 0), FRAMES)
    panned = replace(moving, camera=replace(moving.camera, path=path_of(turns, places)))
    for name in ("trc", "c3d"):
        assert not read_reference(exported(panned, name, tmp_path)).in_camera
        assert read_reference(exported(panned, name, tmp_path, axes="camera")).in_camera


def test_a_set_of_ones_own(moving: Motion, tmp_path: Path):
    from fitting_core.body.markers.marker_set import read_marker_set

    content = {"radius": 12.5, "markers": {"cluster1": 5000, "Knee": "LKNE", "centre": "left_knee"}}
    (tmp_path / "own.json").write_text(json.dumps(content))
    (tmp_path / "own.toml").write_text('radius = 12.5\n[markers]\ncluster1 = 5000\nKnee = "LKNE"\ncentre = "left_knee"')
    own = read_marker_set(tmp_path / "own.toml")
    assert read_marker_set(tmp_path / "own.json") == own
    names, _, places, _ = parsed_trc(exported(moving, "trc-markers", tmp_path, markers=own))
    assert names == ["cluster1", "Knee", "centre"]
    np.testing.assert_allclose(places[:, 0], y_up(on_the_skin(moving, "", 5000, 0.0125)), atol=0.05)
    np.testing.assert_allclose(places[:, 2], 1e3 * y_up(moving.joints()[:, JOINTS.index("left_knee")]), atol=0.01)
    with pytest.raises(InputError, match="left_knee is the name of a joint"):
        exported(moving, "c3d", tmp_path, markers=replace(own, targets={"left_knee": 3}))
    with pytest.raises(InputError, match=r"vertex 99999, .* has 13492 vertices"):
        exported(moving, "trc-markers", tmp_path, markers=replace(own, targets={"a": 99999}))
