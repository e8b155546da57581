"""Warnings about implausible fits, and about evidence that was changed or ignored."""

import numpy as np

from fitting_core.body.model import BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.clip import Clip
from fitting_core.fit.evidence.observations import Observations
from fitting_core.ground.grounding import Grounding
from fitting_core.keypoints import BODY, SEEN
from fitting_core.results.given_start import KnownShape
from fitting_core.video.frame_names import spans

_FAR, _NEAR = 60.0, 0.25
"""Distances in metres from the camera at which keypoints of people can be found."""
_GROWN = 145.0
"""Centimetres below which people are mostly children."""
_AGREES = 3.0
"""Centimetres: two standard deviations of heights as people state them."""
_SMALL = 24.0
"""Pixels of a person's larger side: less than a detector's own errors times ten."""


def doubts(clip: Clip, params: BodyParams) -> tuple[str, ...]:
    """Sentences about a fit whose keypoints or camera cannot be those of a person; empty for other fits.

    Args:
        clip: What was fitted.
        params: Of the last phase.
    """
    found = []
    size = _median_size(clip)
    if size is not None and size < _SMALL:
        found.append(
            f"the keypoints of the person lie within {size:.0f} px, too few to tell a pose; expected at least "
            f"{_SMALL:.0f} px. Check the keypoints, or use a larger image"
        )
    distance = float(params.camera_translation[:, 2].median()) if len(params) else np.nan
    if not (np.isnan(distance) or _NEAR < distance < _FAR):
        found.append(
            f"the body is {distance:.3g} m from the camera; plausible is {_NEAR} to {_FAR:.0f} m. "
            "Check the keypoints and the focal length"
        )
    return tuple(found)


def small_adult(body: BodyModel, height: float | None) -> tuple[str, ...]:
    """A sentence about an adult's body with a child's height in centimetres; empty for other bodies."""
    if height is None or height >= _GROWN or body.gender == "child":
        return ()
    return (
        f"a height of {height:g} cm is rare for an adult, and the body has adult proportions; for a child choose "
        "the body of a child (gender child)",
    )


def other_height(body: BodyModel, shape: KnownShape | None, height: float | None) -> tuple[str, ...]:
    """A sentence about a given shape that disagrees with the stated height in centimetres; empty if they agree."""
    if shape is None or height is None:
        return ()
    mean, by_betas = body.height
    own = 100 * (mean + float(by_betas @ shape.betas))
    if abs(own - height) < _AGREES:
        return ()
    return (f"the shape of {shape.source} is {own:.0f} cm tall, not {height:g} as stated: the shape is used",)


def unswapped_limbs(observations: Observations, first_frame: int) -> list[str]:
    """Warnings about limbs whose left and right were unswapped, with frames counted from `first_frame`."""
    swapped = {name: spans((first_frame + frames).tolist()) for name, frames in observations.swaps.items()}
    return [
        f"left and right {name} were swapped in the keypoints and have been unswapped: frames {numbers}"
        for name, numbers in swapped.items()
    ]


def feet_let_go(grounding: Grounding | None, first_frame: int) -> list[str]:
    """A warning about feet that seem to stand but move in the image; empty without such feet."""
    where = "" if grounding is None else grounding.contacts.let_go_in_words(first_frame)
    return [f"feet that seem to stand move in the image, and are not held: {where}"] if where else []


def _median_size(clip: Clip) -> float | None:
    """Larger side of the box around the body's keypoints, pixels; None if no frame shows two of them."""
    sizes = []
    for xy, confidence in zip(clip.keypoints.xy[:, BODY], clip.keypoints.confidence[:, BODY], strict=True):
        seen = xy[confidence > SEEN]
        if len(seen) > 1:
            sizes.append(float(np.ptp(seen, axis=0).max()))
    return float(np.median(sizes)) if sizes else None
