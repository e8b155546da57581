"""The result with which a fit begins, as the options of a command line or the cells of a list say it."""

from fitting_core.body.model import BodyModel
from fitting_core.clip import Clip
from fitting_core.errors import InputError
from fitting_core.results.given_start import GivenStart
from fitting_core.starts.reading import read_start
from tcfit_app.fitting.bodies import Bodies
from tcfit_app.imports.results import vposer_decoder
from tcfit_app.options.fit import StartOptions


def start_of(options: StartOptions, clip: Clip, body: BodyModel, bodies: Bodies) -> GivenStart | None:
    """The start that the options name; None if they name none.

    Args:
        options: What the user gave.
        clip: What is fitted.
        body: The fitted body.
        bodies: Where the result's own body may be.

    Raises:
        InputError: It cannot be read, has nothing for this clip, or nobody in it follows the keypoints; or there is
            none, and something is said of it.
    """
    if options.start is None:
        said = {"--start-person": options.start_person, "--start-first-frame": options.start_first_frame}
        if named := [name for name, value in said.items() if value is not None]:
            raise InputError(f"{' and '.join(named)} without --start: say with --start which result is meant.")
        return None

    def found(kind: str, gender: str) -> BodyModel | None:
        try:
            return bodies.find(kind=kind, gender=gender)
        except InputError:  # Without it joints lie where the fitted body has them.
            return None

    return read_start(
        options.start,
        clip,
        body,
        person=options.start_person,
        first_frame=options.start_first_frame,
        find_body=found,
        decode=vposer_decoder(),
    )
