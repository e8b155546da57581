"""Exports of the list: what can be chosen, and what is written where."""

from pathlib import Path

import pytest

from fitting_core.body.model import BodyModel
from fitting_core.errors import InputError
from tcfit_app.fitting.process_queue import Work
from tcfit_app.home.exporting import export_project, offered
from tcfit_app.home.found import find
from tcfit_app.project.project import Project
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_project


def test_what_can_be_chosen():
    formats = offered()
    names = [choice.value for choices in formats.groups.values() for choice in choices]
    assert {"glb", "overlay", "openpose"} < set(names) and set(formats.chosen) < set(names)
    assert [choice.value for choice in formats.axes] == ["", "camera", "y-up", "z-up"]


def test_files_beside_the_project_which_are_no_clips(tmp_path: Path, free_body: BodyModel):
    folder, told = waving_project(tmp_path / "walk.tcfit", free_body), list[Work]()
    with Project.open(folder):  # somebody may have it open
        said = export_project(folder, told.append, formats=("joints", "bvh", "coco"), axes="z-up")
    out = tmp_path / "walk.exports"
    assert sorted(path.name for path in out.iterdir()) == [
        "walk-bvh",
        "walk.coco-wholebody.json",
        "walk.joints.csv",
    ]
    assert said.startswith("Exported to walk.exports")
    shares = [work.share for work in told if work.share is not None]
    assert shares == sorted(shares) and shares[-1] == 1.0 and told[0].step == "Exporting: Joints (CSV)"
    (out / "walk.mp4").write_bytes(b"x")
    assert [one.place for one in find(tmp_path)] == ["walk.tcfit"]
    export_project(folder, told.append, formats=("joints",))  # again, in place of it


def test_links_are_not_followed(tmp_path: Path, free_body: BodyModel):
    """Others may write beside a project, and the list replaces files with the rights of who serves it."""
    folder, elsewhere = waving_project(tmp_path / "walk.tcfit", free_body), tmp_path / "elsewhere"
    elsewhere.mkdir()
    out = tmp_path / "walk.exports"
    for link in (out, out / "walk-bvh"):
        link.symlink_to(elsewhere)
        with pytest.raises(InputError, match=rf"{link.name}: is a link, and exports would go where it leads"):
            export_project(folder, lambda work: None, formats=("joints", "bvh"))
        link.unlink()
        out.mkdir(exist_ok=True)
    (elsewhere / "kept.csv").write_text("kept")
    (out / "walk.joints.csv").symlink_to(elsewhere / "kept.csv")
    export_project(folder, lambda work: None, formats=("joints",))
    assert (elsewhere / "kept.csv").read_text() == "kept", "a file that is a link is replaced itself"
    assert [path.name for path in elsewhere.iterdir()] == ["kept.csv"]


def test_a_format_that_is_not_known_or_has_nothing_to_write(tmp_path: Path):
    folder = tmp_path / "walk.tcfit"
    Project.create(folder, sample_clip()).close()
    with pytest.raises(InputError, match="no fit to export"):
        export_project(folder, lambda work: None, formats=("glb",))
    with pytest.raises(InputError, match="not known"):
        export_project(folder, lambda work: None, formats=("magic",))
    assert not (tmp_path / "walk.exports").exists()
