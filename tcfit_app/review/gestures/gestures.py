"""Everything that the user of one tab can do, by subject: what keys, buttons and the pointer call."""

from tcfit_app.review.gestures.correcting import Correcting
from tcfit_app.review.gestures.fitting import Fitting
from tcfit_app.review.gestures.reviewing import Reviewing
from tcfit_app.review.tab.tab import Tab


class Gestures:
    """The gestures of one tab; they raise InputError for what cannot be done, and then nothing changes."""

    def __init__(self, tab: Tab) -> None:
        self.tab = tab
        self.correcting, self.reviewing, self.fitting = Correcting(tab), Reviewing(tab), Fitting(tab)
