"""Other views in a project: added, corrected, removed and undone like edits; their videos linked, copied."""

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fitting_core.clip import Clip, OtherView
from fitting_core.errors import InputError
from fitting_core.fit.views.relating import related
from fitting_core.keypoints import INDEX
from tcfit_app.project.edits.edit_log import decode, encode
from tcfit_app.project.edits.kinds import AddView, MarkBad, MoveKeypoint, check
from tcfit_app.project.project import Project
from tcfit_app.project.storage.database import NAME
from tests.samples.media import write_video
from tests.samples.project_samples import CAMERA, FRAMES, sample_clip, sample_view
from tests.samples.two_views import seen_from

WRIST = INDEX["right_wrist"]
COUNT_OF_OTHER = 2 * FRAMES


def filmed(folder: Path) -> Clip:
    """A clip with another view, both with videos."""
    folder.mkdir(exist_ok=True)
    clip = replace(sample_clip(), source=write_video(folder / "a.mp4", frames=FRAMES + 10))
    view = sample_view(clip, name="b", count=COUNT_OF_OTHER, times=np.arange(COUNT_OF_OTHER) / (2 * clip.frame_rate))
    return replace(clip, views=(with_video(view, folder / "b.mp4"),))


def with_video(view: OtherView, path: Path) -> OtherView:
    return replace(view, clip=replace(view.clip, source=write_video(path, frames=COUNT_OF_OTHER, size=(64, 48))))


def same(one: OtherView, other: OtherView) -> bool:
    xy = np.allclose(one.clip.keypoints.xy, other.clip.keypoints.xy, rtol=1e-6)
    times = np.array_equal(np.array(one.times), np.array(other.times))
    plain = [(v.relation, v.clip.camera, v.clip.name, v.clip.source, v.clip.frame_rate) for v in (one, other)]
    return bool(xy and times and plain[0] == plain[1])


def names(project: Project) -> list[str]:
    return [view.view.clip.name for view in project.views]


def test_add_correct_remove_undo_pack_and_open_elsewhere(tmp_path: Path):
    clip = filmed(tmp_path / "films")
    folder, (b,) = tmp_path / "walk.tcfit", clip.views
    with Project.create(folder, replace(clip, views=())) as project:
        before = project.clip
        entry = project.add_view(b, author="me")
        assert project.undoable == entry and project.clip is not before and same(project.clip.views[0], b)
        project.undo()
        assert not project.views and not project.clip.views
        project.redo()
        assert project.views[0].id == entry.id and same(project.clip.views[0], b)
        c = replace(b, clip=replace(b.clip, name="c", source=None))
        project.add_view(c)
        project.append(project.removal_of_view(entry.id))
        assert names(project) == ["c"]
        with pytest.raises(InputError, match="no longer there"):
            project.append(project.removal_of_view(entry.id))
        project.undo()
        assert names(project) == ["b", "c"]
        untouched = project.views[1]
        move = MoveKeypoint(frames=(4,), joints=(WRIST,), xy=(((5.0, 6.0),),))
        correction = project.edit_of_view(entry.id, move)
        assert correction.frames == (3,), "frame 4 of 60 per second, whose clock is a frame of 30 behind"
        project.append(correction)
        keypoints = project.clip.views[0].clip.keypoints
        assert (
            keypoints.xy[4, WRIST].tolist() == [5.0, 6.0]
            and keypoints.placed[4, WRIST]
            and project.views[1] is untouched
        )
        assert project.frames_edited_since(project.last_edit - 1) == {3}
        assert project.standing.differing(0) == 3
        with pytest.raises(InputError, match=f"no frame {COUNT_OF_OTHER + 3}"):
            project.edit_of_view(entry.id, MarkBad(frames=(COUNT_OF_OTHER + 3,), joints=(WRIST,)))
        expected = project.clip.views[0]
    with Project.open(folder) as project:
        assert names(project) == ["b", "c"] and not project.damage and same(project.clip.views[0], expected)
        assert project.views[0].media.path == tmp_path / "films" / "b.mp4"
        assert project.views[0].corrected.edited[4, WRIST]

    shutil.move(tmp_path / "films", tmp_path / "elsewhere")
    with Project.open(folder) as project:
        assert project.views[0].media.path is None and "no longer there" in project.views[0].media.problem
        source = tmp_path / "elsewhere" / "b.mp4"
        project.relink(source, view=entry.id)
        assert not project.views[0].media.problem
        assert same(project.clip.views[0], replace(expected, clip=replace(expected.clip, source=source)))


def test_a_project_of_a_clip_with_views_has_them_and_copies_their_videos(tmp_path: Path):
    clip = filmed(tmp_path)
    (tmp_path / "c").mkdir()
    both = (*clip.views, with_video(clip.views[0], tmp_path / "c" / "b.mp4"))
    with Project.create(tmp_path / "linked.tcfit", replace(clip, views=both)) as project:
        assert [view.media.path for view in project.views] == [tmp_path / "b.mp4", tmp_path / "c" / "b.mp4"]
    (tmp_path / "moved").mkdir()
    for name in ("linked.tcfit", "b.mp4"):  # links are relative to the folder
        (tmp_path / name).rename(tmp_path / "moved" / name)
    with Project.open(tmp_path / "moved" / "linked.tcfit") as project:
        assert project.views[0].media.path == tmp_path / "moved" / "b.mp4"
    clip = replace(clip, views=(with_video(clip.views[0], tmp_path / "b.mp4"), both[1]))
    with Project.create(tmp_path / "copied.tcfit", clip, copy_media=True) as project:
        assert sorted(path.name for path in (project.folder / "media").iterdir()) == ["a.mp4", "b-2.mp4", "b.mp4"]
        assert all(view.media.path and view.media.path.is_relative_to(project.folder) for view in project.views)


def test_another_focal_length_needs_another_relation(tmp_path: Path):
    with Project.create(tmp_path / "a.tcfit", filmed(tmp_path)) as project:
        longer = replace(CAMERA, focal=(900.0, 900.0))
        assert project.clip.views[0].relation is not None and project.clip_by(longer).views[0].relation is None
        project.set_camera(longer)
        assert project.clip.views[0].relation is None and project.clip_by(CAMERA).views[0].relation is not None


def test_a_relation_for_another_camera_is_found_once(tmp_path: Path):
    clip, longer = seen_from(10), replace(seen_from(10).camera, focal=(1600.0, 1600.0))
    with Project.create(tmp_path / "a.tcfit", related(clip, [OtherView(clip=seen_from(80, seed=1))])) as project:
        (found,) = project.related_clip(longer).views
        assert found.relation not in (None, project.views[0].view.relation)
        assert project.clip_by(longer).views == (found,) and project.related_clip(longer).views == (found,)


def test_a_link_that_is_damaged_leaves_the_view(tmp_path: Path):
    Project.create(tmp_path / "a.tcfit", filmed(tmp_path)).close()
    with closing(sqlite3.connect(tmp_path / "a.tcfit" / NAME)) as connection:
        connection.execute("UPDATE views SET media = '{'")
        connection.commit()
    with Project.open(tmp_path / "a.tcfit") as project:
        assert project.views[0].media.problem and len(project.clip.views) == 1
        assert any("the video of view 1" in damage for damage in project.damage)


def test_pixels_of_a_frame_belong_to_the_nearest_in_time(tmp_path: Path):
    with Project.create(tmp_path / "a.tcfit", filmed(tmp_path)) as project:
        rate = project.clip.frame_rate
        assert [project.views[0].frame_at(frame, rate) for frame in (0, 1, 3, FRAMES)] == [None, 0, 4, 10]


ADDED = AddView.of(sample_view(sample_clip(), name="b", count=8), sample_clip())


def added(**fields: object) -> AddView:
    return msgspec.structs.replace(ADDED, **fields)


def test_an_added_view_reads_back_from_its_text():
    edit = added(times=tuple(np.arange(8.0).tolist()))
    assert decode(encode(edit)) == edit
    check(edit, FRAMES)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (added(joints=(3,)), "keypoints of the clip itself"),
        (added(count=1), "1 frames, expected 2 or more"),
        (added(count=9), "one position for each of 9 frames"),
        (added(count=10**30), "one position for each of"),
        (added(packed=b"\x01" * 20), "cannot be unpacked"),
        (added(times=(0.0, 1.0)), "2 times for 8 frames"),
        (added(name="a\nb"), "not one line"),
        (added(focal=(0.0, 700.0)), "not positive"),
        (added(camera=replace(CAMERA, focal=(-1.0, 1.0))), "camera of the view"),
        (added(relation=replace(ADDED.relation, rotation=((1.0, 0.0, 0.0),) * 3)), "how it relates"),
    ],
)
def test_views_that_cannot_be_are_refused(edit: AddView, message: str):
    with pytest.raises(InputError, match=message):
        check(edit, FRAMES)
