"""Another camera for a project: what changes with it, what stays, and when another lens comes too late."""

import json
import sqlite3
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting_core.camera import Camera, FocalFrom, Lens
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.lens import filmed_keypoints
from tcfit_app.project.edits.kinds import SwapSides
from tcfit_app.project.project import Project
from tcfit_app.project.storage import database
from tcfit_app.project.storage.clip import replace_detections
from tests.samples.project_samples import BODY, CONFIG, random_edit, sample_fit


def bent(camera: Camera, strength: float = -0.05) -> Camera:
    lens = Lens(focal=camera.focal, center=camera.center, distortion=(strength, 0.0, 0.0, 0.0))
    return replace(camera, lens=lens, focal_from=FocalFrom.FILE, source="camera file a.toml, as given")


def test_another_focal_length_is_kept_and_runs_have_theirs(project: Project):
    before = project.clip
    run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
    project.runs.finish(run.id, sample_fit(0))
    project.append(random_edit(0))
    corrected, fitted = project.clip.keypoints, project.runs.load(run.id).camera
    for name, focal in (("a.toml", 800.0), ("b.toml", 900.0)):
        camera = replace(before.camera, focal=(focal, focal), source=f"camera file {name}, camera 1")
        project.set_camera(camera, (f"{name}: camera 1 stands somewhere.",))
    for one in (project, Project.open(project.folder, read_only=True)):
        assert one.clip.camera == camera and one.runs.load(run.id).camera == fitted
        assert one.clip.notes == (*before.notes, "b.toml: camera 1 stands somewhere."), "the other file's have gone"
        np.testing.assert_array_equal(one.clip.keypoints.xy, corrected.xy)
    one.close()


def test_another_lens_straightens_what_was_detected(project: Project):
    before = project.clip
    camera = bent(before.camera)
    project.set_camera(camera)
    straight = project.clip.keypoints
    assert np.abs(straight.xy - before.keypoints.xy).max() > 0.1
    with Project.open(project.folder, read_only=True) as again:
        assert again.clip.camera == camera
        np.testing.assert_array_equal(again.detections.xy, straight.xy)
    seen = straight.confidence > 0
    filmed = filmed_keypoints(straight, camera.lens)
    np.testing.assert_allclose(filmed.xy[seen], before.keypoints.xy[seen], atol=0.02)
    project.set_camera(before.camera)
    np.testing.assert_allclose(project.clip.keypoints.xy[seen], before.keypoints.xy[seen], atol=0.02)


@pytest.mark.parametrize("what", ["edits", "runs"])
def test_another_lens_comes_too_late_for_edits_and_runs(project: Project, what: str):
    project.marks.set((1,), "checked", author="me")
    project.set_camera(bent(project.clip.camera))
    if what == "edits":
        project.append(SwapSides(frames=(0,), joints=(2, 3, 4, 5, 6, 7)))
    else:
        project.runs.delete(_finished(project))
    before = project.clip
    with pytest.raises(InputError, match=f"lens differs from the project's, on which {what} depend"):
        project.set_camera(bent(before.camera, -0.1))
    assert project.clip is before


@pytest.mark.parametrize("full", [False, True], ids=["written", "a full disk"])
@pytest.mark.parametrize("change", ["lens", "person"])
def test_edits_and_runs_are_refused_while_keypoints_are_replaced(
    change: str, full: bool, project: Project, monkeypatch: pytest.MonkeyPatch
):
    """They would stand on the pixels of the keypoints that were there before."""
    module, refused = "tcfit_app.project.project", list[str]()
    write = replace_detections

    def start() -> None:
        project.runs.start(CONFIG, body=BODY, edits_seen=0)

    def write_while_others_work(folder: Path, store: database.Database, clip: Clip) -> None:
        project.marks.set([0], "flag")  # stays true of any keypoints
        for act in (lambda: project.append(random_edit(0)), start):
            with pytest.raises(InputError, match="are being replaced") as error:
                act()
            refused.append(str(error.value))
        if full:
            raise InputError("The disk is full.")
        write(folder, store, clip)

    monkeypatch.setattr(f"{module}.replace_detections", write_while_others_work)
    with suppress(InputError):
        if change == "lens":
            project.set_camera(bent(project.clip.camera))
        else:
            project.take_detections(project.detections, before=project.clip)
    assert len(refused) == 2 and not project.runs.all()
    assert list(project.marks.all()) == [0]
    project.append(random_edit(0))
    start()


def _finished(project: Project) -> int:
    run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
    return project.runs.finish(run.id, sample_fit(0)).id


def test_a_camera_of_other_images_is_refused(project: Project):
    with pytest.raises(InputError, match=r"images of \(2, 2\); expected"):
        project.set_camera(replace(project.clip.camera, size=(2, 2)))


def test_a_project_of_an_earlier_version(project: Project):
    """It says where the focal length comes from in words alone, and has the camera file's notes among the clip's."""
    words = "camera file b.toml, camera 1, as given"
    camera = replace(project.clip.camera, focal_from=FocalFrom.FILE, source=words)
    notes = (*project.clip.notes, "b.toml: it has several cameras.")
    project.set_camera(camera, notes[-1:])
    run = project.runs.start(CONFIG, body=BODY, edits_seen=0)
    project.runs.finish(run.id, replace(sample_fit(0), camera=replace(camera, focal_from=FocalFrom.PROGRAM)))
    project.close()
    with sqlite3.connect(project.folder / database.NAME) as connection:
        (stored,) = connection.execute("SELECT camera FROM clip").fetchone()
        old = {key: value for key, value in json.loads(stored).items() if key not in ("focal_from", "notes")}
        connection.execute("UPDATE clip SET camera = ?", (json.dumps(old),))
    connection.close()
    with Project.open(project.folder) as again:
        assert again.clip.camera.focal_from is FocalFrom.FILE and again.clip.notes == notes
        assert again.runs.load(run.id).camera.focal_from is FocalFrom.PROGRAM
        again.set_camera(replace(camera, source="another"))
        assert again.clip.notes == notes[:-1]
