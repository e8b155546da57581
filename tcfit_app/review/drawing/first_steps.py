"""The first steps shown to someone who opens the app for the first time."""

from tcfit_app.review.browser.page_states import Hint, Hints
from tcfit_app.review.gestures.actions import ACTIONS

_STEPS = (
    ("Play the clip. The arrow keys go frame by frame.", "play"),
    ("Fit everything, if there is no fit yet.", "fit"),
    ("Go to the next suspicious frame.", "next_suspect"),
    ("Drag a wrong keypoint: the fit follows, and the correction is saved. Undo reverts it.", "undo"),
    ("Drag in the timeline's ruler to select frames, and fit them again.", "rerun"),
    ("Compare: A | B shows the fit before beside the new one, and the panel Compare has the figures.", "ab"),
    ("Your own video: keypoints are detected automatically. In the terminal: tcfit review VIDEO --fit", ""),
    ("All keys. These first steps are there too.", "help"),
)


def first_steps() -> Hints:
    """Each step with the key of what it says."""
    first = {name: next(map(str, ACTIONS[name].keys), "") for _, name in _STEPS if name}
    return Hints(steps=tuple(Hint(text=text, keys=first.get(name, "")) for text, name in _STEPS))
