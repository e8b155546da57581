"""The bar under the picture: playing, the selected frames, and what is visible."""

from functools import partial

from fitting_core.keypoints import GROUPS
from tcfit_app.review.gestures.actions import ACTIONS, NEEDS, Gestures, key_text, refusal
from tcfit_app.review.gestures.zooming import show_close_up
from tcfit_app.review.panels.elements.html import (
    Html,
    Item,
    Strip,
    action,
    action_item,
    button,
    choice,
    joined,
    menu_button,
    symbol,
    tag,
    text,
    worded,
)
from tcfit_app.review.scene.layers import DISTANCE_LIMIT, color_table, css
from tcfit_app.review.scene.side_view import DIRECTION_TEXTS
from tcfit_app.review.tab.state import CLOSE_UPS, CONTROLS, SPEEDS, Mode, Section

_NOW, _FRAMES, _SPRING = (tag("div", "", class_=f"tcfit-{name}") for name in ("now", "frames", "spring"))
"""Where the page draws the frame on show and the selected frames; and what takes the room that is left."""
_SHADES = ", ".join(css((r, g, b)) for r, g, b in color_table()[:: len(color_table()) // 8].tolist())
_DISTANCES = tag(
    "div",
    joined(
        tag("span", "0"),
        tag("i", "", style=f"background: linear-gradient(to right, {_SHADES})"),
        tag("span", f"{1e3 * DISTANCE_LIMIT:g} mm"),
    ),
    class_="tcfit-spring",
    title="Distance between the two fits",
)
"""Instead of the latter: what the colours of a body say."""


class Bar:
    """Draws one tab's bar; called repeatedly, it sends only changes."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        self._action, self._item = partial(action, gestures), partial(action_item, gestures)
        self._strip = Strip(gestures.tab, "bar")

    def draw(self) -> None:
        """Send what changed."""
        self._strip.show(
            self._transport(),
            _NOW,
            self._speed(),
            self._action("loop", symbol("repeat")),
            _FRAMES,
            self._distances(),
            self._body(),
            self._keypoints(),
            self._side(),
            self._mode("space", "3D"),
            choice(
                self._mode("ab", worded("columns-2", "Compare")),
                self._more("compare", self._comparing(), "How to compare"),
            ),
            menu_button(
                joined(worded("zoom-in", "Zoom"), text("▾")),
                "bar.zoom",
                self._zooms(),
                hint="What the picture shows",
            ),
        )

    def _more(self, name: str, items: list[Item | None], hint: str) -> Html:
        return menu_button("▾", f"bar.{name}", items, name=hint, hint=hint)

    def _transport(self) -> Html:
        playing = self._tab.state.playing
        play = symbol("player-pause-filled" if playing else "player-play-filled")
        return choice(
            self._action("previous", symbol("chevron-left")),
            self._action("play", play, kind="main", hint="Pause" if playing else "Play"),
            self._action("next", symbol("chevron-right")),
        )

    def _speed(self) -> Html:
        tab = self._tab
        speeds: list[Item | None] = [
            Item(label=f"{speed:g}×", do=partial(tab.set, speed=speed), chosen=tab.state.speed == speed)
            for speed in SPEEDS
        ]
        return menu_button(f"{tab.state.speed:g}× ▾", "bar.speed", speeds, hint="Speed")

    def _mode(self, mode: Mode, label: object) -> Html:
        """The switch of a mode; off is Edit."""
        gestures, on = self._gestures, self._tab.state.mode == mode
        return button(
            label,
            "bar.mode",
            mode,
            do=lambda: gestures.run("edit" if on else mode),
            pressed=on,
            obstacle=ACTIONS[mode].obstacle(gestures),
            hint=f"{ACTIONS[mode].title} ({key_text(mode)}); off: Edit ({key_text('edit')})",
        )

    def _switches(self, section: Section) -> list[Item | None]:
        alone = ["others"] if ACTIONS["others"].obstacle(self._gestures) else []
        return [self._item(name) for name, row in CONTROLS.items() if row.section == section and name not in alone]

    def _body(self) -> Html:
        items = [*self._switches("body"), None, self._item("denser"), self._item("fainter")]
        return choice(self._action("bodies", worded("man", "Body")), self._more("body", items, "How the body is drawn"))

    def _keypoints(self) -> Html:
        tab = self._tab
        groups = (
            Item(
                label=name.replace("_", " ").capitalize(),
                do=lambda name=name: tab.set(groups=tab.state.groups ^ {name}),
                checked=name in tab.state.groups,
            )
            for name in GROUPS
        )
        return choice(
            self._action("keypoints", worded("chart-dots-3", "Keypoints")),
            self._more("keypoints", [*groups, None, self._item("all")], "Groups of keypoints"),
        )

    def _side(self) -> Html:
        tab, gestures = self._tab, self._gestures
        views = [(number, view.view.clip.name, "") for number, view in tab.session.views.items()]
        why = refusal(NEEDS["bodies"], gestures)
        sides = [(name, text.capitalize(), why) for name, text in DIRECTION_TEXTS.items()]
        now = tab.state.side_from if tab.view else tab.direction
        ways: list[Item | None] = [
            Item(
                label=label,
                do=partial(tab.set, side=True, side_from=name),
                obstacle=obstacle,
                chosen=tab.state.side and now == name,
            )
            for name, label, obstacle in (*views, *sides)
        ]
        held = tab.shown.held
        known = held is None or tab.data.level(held) is not None
        switch = self._action(
            "side",
            worded("layout-sidebar-right", "Side view"),
            hint="" if known else "Side view on or off; gravity is not known",
        )
        return choice(switch, self._more("side", ways, "From where"))

    def _distances(self) -> Html:
        state = self._tab.state
        return _DISTANCES if state.difference and state.bodies else _SPRING

    def _comparing(self) -> list[Item | None]:
        tab, state = self._tab, self._tab.state
        beside = Item(
            label="Side by side",
            do=partial(tab.set, mode="ab", wipe=False),
            obstacle=ACTIONS["ab"].obstacle(self._gestures),
            chosen=state.mode == "ab" and not state.wipe,
        )
        return [
            beside,
            self._item("wipe", "Divider", chosen=state.mode == "ab" and state.wipe),
            None,
            *self._switches("compare"),
            None,
            Item(label="Choose fits …", do=self._choose_fits),
        ]

    def _choose_fits(self) -> None:
        """Compare, and show the panel that says what with."""
        if not self._tab.state.comparing:
            self._tab.set(mode="ab")
        self._tab.show_panel("Fit")

    def _zooms(self) -> list[Item | None]:
        tab = self._tab
        why = ACTIONS["close_up"].obstacle(self._gestures)
        parts = [
            Item(
                label=f"Close-up: {title.lower()}",
                do=partial(show_close_up, tab, part),
                obstacle=why,
                chosen=tab.state.close_up == part,
            )
            for part, title in CLOSE_UPS.items()
        ]
        off = Item(label="Close-up off", do=partial(show_close_up, tab, None), obstacle=why)
        whole = "Whole body" if tab.state.mode == "space" else "Whole picture"
        following = [off] if tab.state.close_up else []
        return [self._item("fit_view", whole), self._item("zoom"), None, *parts, *following]
