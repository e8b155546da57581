"""Folders of clips for tests of the list."""

import shutil
from dataclasses import replace
from pathlib import Path

from fitting_core.body.model import BodyModel
from tcfit_app.project.project import Project
from tcfit_app.project.storage.clip_review import Worst, reviewed
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_project


def folder_of_clips(root: Path, body: BodyModel) -> Path:
    """Four projects: new, fitted, in review by anna, approved by bert."""
    root.mkdir()
    Project.create(root / "a new.tcfit", replace(sample_clip(), name="a new")).close()
    first = waving_project(root / "walk.tcfit", body)
    for name in ("b fitted", "c reviewed", "d approved"):
        folder = Path(shutil.copytree(first, root / "set" / f"{name}.tcfit"))
        if name != "b fitted":
            with Project.open(folder) as project:
                project.marks.set([1], "checked", author="anna")
        with reviewed(folder) as review:
            if name != "b fitted":
                left, score = (2, 3.5) if name == "c reviewed" else (0, 0.0)
                review.set_worst(Worst(run=2, left=left, score=score, frame=3, words="left wrist is 42 px off"))
            if name == "d approved":
                review.approve("bert")
                review.set_note("good hands")
    shutil.rmtree(first)
    return root
