"""`tcfit import`: another program's result as a run of a project, or ELAN's annotations as notes."""

import sys

from fitting_core.errors import InputError, printable
from fitting_core.io.eaf import SUFFIX
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.elan import import_notes
from tcfit_app.imports.results import ImportChoices, import_run
from tcfit_app.options.import_ import ImportOptions
from tcfit_app.project.project import Project


def run_import(options: ImportOptions) -> None:
    """Import the result, and print its run. Raises InputError if the project cannot be opened for writing, the result
    cannot be read or does not match the clip, or its body is missing; nothing is written then."""
    if options.path.suffix.lower() == SUFFIX:
        _import_notes(options)
        return
    if options.tiers:
        raise InputError(f"--tiers: {options.path} is not an {SUFFIX} file, so it has no tiers. Leave the option out.")
    choices = ImportChoices(
        first_frame=options.first_frame,
        person=options.person,
        gender=options.gender,
        body_model=options.body_model,
        focal_length=options.focal_length,
    )
    with Project.open(options.project) as project:
        run = import_run(project, Bodies(options.models), options.path, choices, name=options.name)
        fit = project.runs.load(run.id)
    for note in fit.last.notes:
        print(printable(f"Note: {note}"), file=sys.stderr)
    print(
        f"Imported as run {run.id}, {run.name}: {len(fit.last.params)} frames, {run.body.gender} {run.body.kind} body"
    )


def _import_notes(options: ImportOptions) -> None:
    said = {name: getattr(options, name) for name in _OF_RESULTS}
    if named := [name for name, value in said.items() if value not in (None, "")]:
        raise InputError(f"--{named[0].replace('_', '-')}: has no meaning for {options.path}, which holds annotations.")
    with Project.open(options.project) as project:
        found = import_notes(project, options.path, options.tiers)
    print(f"Imported {found.in_words()}")


_OF_RESULTS = ("name", "first_frame", "person", "gender", "body_model", "models", "focal_length")
"""Options for results."""
