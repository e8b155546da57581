"""A result of `tcfit fit` or `tcfit batch` as a project, as `tcfit batch --projects` makes it at once."""

from pathlib import Path

from fitting_core.io.whole_result import read_whole_result
from tcfit_app.project.project import Project
from tcfit_app.project.storage.run_record import BodyRecord


def project_of_result(result: Path, folder: Path) -> None:
    """Make a project with a result's keypoints and its fit as the first run, whole or not at all.

    Args:
        result: Its folder.
        folder: Of the project; must not exist, or be empty.

    Raises:
        InputError: As of `read_whole_result` and `Project.create`.
    """
    whole = read_whole_result(result)
    stored, fit = whole.stored, whole.fit
    body = BodyRecord(kind=stored.body_kind, gender=stored.gender, hash=stored.body_hash)

    def begin(project: Project) -> None:
        project.set_height(fit.config.height)
        project.runs.add(fit, body=body, edits_seen=project.last_edit, kind="fit", summary=whole.summary)

    Project.create(folder, whole.clip, begin=begin).close()
