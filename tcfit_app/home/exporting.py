"""Exports of a clip of the list, into a folder beside its project."""

from pathlib import Path
from typing import Any, get_args

import torch

from fitting_core.errors import InputError
from fitting_core.motion import OWN_WORLD
from tcfit_app.exports.exporting import write_export
from tcfit_app.exports.from_path import formats_of, source_of, target
from tcfit_app.exports.table import AXES_CHOICES, DEFAULTS, VIEW_CHOICES, VIEW_HINT, Group, exports
from tcfit_app.fitting.process_queue import Report, Work
from tcfit_app.home.found import exports_beside
from tcfit_app.home.messages import Choice, Formats
from tcfit_app.options.export import ExportOptions


def offered() -> Formats:
    """What a page can choose from. What only some clips have is not offered."""
    groups: dict[Group, list[Choice]] = {group: [] for group in get_args(Group)}
    for name, export in exports().items():
        missing = export.missing()
        choice = Choice(value=name, title=export.title, hint=missing or export.hint, missing=bool(missing))
        groups[export.group].append(choice)
    axes = [Choice(value=value, title=title) for value, title in AXES_CHOICES.items() if value != OWN_WORLD]
    views = [Choice(value=value, title=title, hint=VIEW_HINT) for value, (title, _) in VIEW_CHOICES.items()]
    some = {group: choices for group, choices in groups.items() if choices}
    return Formats(groups=some, axes=axes, views=views, chosen=list(DEFAULTS))


def export_project(
    folder: Path,
    report: Report,
    *,
    formats: tuple[str, ...],
    axes: str = "",
    view: str = "",
    models: Path | None = None,
) -> str:
    """Write the newest fit and keypoints of a project; files of the same names are replaced.

    Args:
        folder: Of the project.
        report: Receives the progress.
        formats: Of `exports`.
        axes: Of AXES_CHOICES.
        view: Of VIEW_CHOICES.
        models: Folder of body models.

    Returns:
        What was written where, for the user.

    Raises:
        InputError: There is nothing to export, or it cannot be written; formats that were whole by then stay.
    """
    torch.set_num_threads(1)  # reviewers use this computer too
    out, names = exports_beside(folder), formats_of(formats)
    wished: dict[str, Any] = {"axes": axes or None, "view": VIEW_CHOICES[view][1]}
    options = ExportOptions(path=folder, out=out, overwrite=True, models=models, **wished)
    notes: list[str] = []
    with source_of(folder, options) as source:
        paths = {name: target(name, source, options) for name in names}
        for done, (name, path) in enumerate(paths.items()):
            export = exports()[name]

            def advance(share: float, step: str = f"Exporting: {export.title}", before: int = done) -> None:
                report(Work(step=step, share=(before + share) / len(paths)))

            try:
                _refuse_links(out)
                out.mkdir(exist_ok=True)
                note = write_export(export, source, path, advance, zipped=False)
            except OSError as error:
                raise InputError(f"{path}: cannot be written ({error.strerror or error}). Free space.") from error
            notes += [f"{path.name}: {note}"] * bool(note)
    return ". ".join([f"Exported to {out.name}", *notes])


def _refuse_links(out: Path) -> None:
    """Raises InputError if the folder of exports, or a folder in it, is a link: files would be replaced elsewhere."""
    inside = out.iterdir() if out.is_dir() and not out.is_symlink() else ()
    for path in (out, *inside):
        if path.is_symlink() and not path.is_file():
            raise InputError(f"{path}: is a link, and exports would go where it leads. Remove it, and export again.")
