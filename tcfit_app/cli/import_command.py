"""`tcfit import`: another program's result as a run of a project."""

import sys

from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.results import ImportChoices, import_run
from tcfit_app.options.import_ import ImportOptions
from tcfit_app.project.project import Project


def run_import(options: ImportOptions) -> None:
    """Import the result that the options name, and say which run it has become.

    Raises:
        InputError: The project cannot be opened for writing, the result cannot be read or does not fit the clip, or its
            body is not there; nothing has been written then.
    """
    choices = ImportChoices(
        first_frame=options.first_frame,
        person=options.person,
        gender=options.gender,
        body_model=options.body_model,
        focal_length=options.focal_length,
        vposer=options.vposer,
    )
    with Project.open(options.project) as project:
        run = import_run(project, Bodies(options.models), options.path, choices, name=options.name)
        fit = project.runs.load(run.id)
    for note in fit.last.notes:
        print(f"Note: {note}", file=sys.stderr)
    print(
        f"Imported as run {run.id}, {run.name}: {len(fit.last.params)} frames, {run.body.gender} {run.body.kind} body"
    )
