"""HTML for the panels: buttons, rows and tables as text, and the element that shows it.

A button carries what it does. Presses come back as `page_events.Press`; the styles are in `browser/web/panels/`. Text
is escaped here; only what the functions of this file return is taken as HTML.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from typing import Any, Literal, TypeVar

from tcfit_app.review.browser.page_states import Markup
from tcfit_app.review.gestures.actions import ACTIONS, Gestures, Key, key_text
from tcfit_app.review.tab.buttons import Presses
from tcfit_app.review.tab.state import CONTROLS
from tcfit_app.review.tab.tab import Tab
from tcfit_app.server.viser_bridge import icon

Value = TypeVar("Value")


class Html(str):
    """Text that is already safe HTML, and what its enabled buttons do."""

    __slots__ = ("presses",)
    presses: Presses

    def __new__(cls, content: str = "", presses: Presses | None = None) -> "Html":
        made = super().__new__(cls, content)
        made.presses = presses or {}
        return made


def text(value: object) -> Html:
    """Anything as HTML; HTML stays as it is."""
    return value if isinstance(value, Html) else Html(escape(str(value)))


def joined(*parts: Html) -> Html:
    """Parts concatenated."""
    return Html("".join(parts), {key: do for part in parts for key, do in part.presses.items()})


def tag(name: str, content: object, **attributes: str) -> Html:
    """An element with attributes; empty ones are omitted, and so is an underscore at the end of a name."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items() if value
    )
    inner = text(content)
    return Html(f"<{name}{given}>{inner}</{name}>", inner.presses)


def symbol(name: str) -> Html:
    """One of viser's icons, before a label or in its place."""
    return Html("".join(map(str.strip, icon(name).splitlines())))


def worded(icon: str, word: str) -> Html:
    """A word around the picture, and the icon that stands for it where there is little room."""
    return joined(symbol(icon), tag("span", word, class_="tcfit-word"))


def button(
    label: object,
    command: str,
    value: str = "",
    *,
    do: Callable[[], object],
    pressed: bool | None = None,
    expanded: bool | None = None,
    disabled: bool = False,
    obstacle: str = "",
    keys: str = "",
    hint: str = "",
    kind: str = "",
    enter: bool = False,
) -> Html:
    """A button.

    Args:
        label: its text.
        command: with `value`, its name among all buttons on show.
        value: tells apart buttons of one command.
        do: what it does.
        pressed: whether a toggle is on.
        expanded: whether the part that it opens and closes is open.
        disabled: cannot be pressed now.
        obstacle: why it cannot be pressed now, if it cannot; its tooltip says so.
        keys: that do the same.
        hint: its tooltip.
        kind: its style: "main", "danger", "mini", "tall", "fold"; "close": in a window, Escape and a click
            outside press it.
        enter: Enter in the text field above presses it.
    """
    off, title = disabled or bool(obstacle), ". ".join(filter(None, (hint, obstacle)))
    shown = joined(tag("span", label), tag("kbd", keys) if keys else Html())
    made = (
        f'<button type="button" data-tcfit="{escape(command)}" data-value="{escape(value)}"'
        + (f' class="tcfit-{escape(kind)}"' if kind else "")
        + (f' aria-pressed="{str(pressed).lower()}"' if pressed is not None else "")
        + (f' aria-expanded="{str(expanded).lower()}"' if expanded is not None else "")
        + (f' title="{escape(title)}"' if title else "")
        + (" data-enter" if enter else "")
        + (" disabled" if off else "")
        + f">{shown}</button>"
    )
    return Html(made, {} if off else {(command, value): do})


def action(
    gestures: Gestures,
    name: str,
    label: object = "",
    *,
    pressed: bool | None = None,
    disabled: bool = False,
    kind: str = "",
    hint: str = "",
) -> Html:
    """A button for one of ACTIONS, with its keys; disabled while the action cannot be done.

    Args:
        gestures: Of the tab.
        name: The action's name.
        label: Its text; empty: that of its switch, or else its title.
        pressed: As in `button`; a switch knows it by itself.
        disabled: Disable it in any case.
        kind: As in `button`.
        hint: Replaces the action's title; the reason why it is disabled is appended.
    """
    known = ACTIONS[name]
    keys, why, control = short_keys(known.keys), known.obstacle(gestures), CONTROLS.get(name)
    if control is not None:
        label, pressed = label or control.label, not why and bool(getattr(gestures.tab.state, name))
    hint = f"{hint or known.title} ({key_text(name)})" if keys else hint or known.title
    return button(
        label or known.title,
        "action",
        name,
        do=lambda: gestures.run(name),
        pressed=pressed,
        disabled=disabled,
        obstacle=why,
        keys=keys,
        hint=hint,
        kind=kind,
    )


@dataclass(frozen=True, kw_only=True)
class Item:
    """A line of a button's menu."""

    label: str
    """Distinct within the menu."""
    do: Callable[[], object] = bool
    keys: str = ""
    """Keys that do the same, for users."""
    obstacle: str = ""
    """Why it cannot be done now; empty if it can."""
    checked: bool | None = None
    """Of a switch, whether it is on."""
    chosen: bool | None = None
    """Of several that exclude each other, whether it is the present one."""
    more: Sequence["Item | None"] = ()
    """Instead of `do`: the submenu."""


def action_item(gestures: Gestures, name: str, label: str = "", *, chosen: bool | None = None) -> Item:
    """A menu's line for one of ACTIONS, as `action` is a button."""
    known = ACTIONS[name]
    why, control, checked = known.obstacle(gestures), CONTROLS.get(name), None
    if control is not None:
        label, checked = label or control.label, not why and bool(getattr(gestures.tab.state, name))
    return Item(
        label=label or known.title,
        do=lambda: gestures.run(name),
        keys=next(map(str, known.keys), ""),
        obstacle=why,
        checked=checked,
        chosen=chosen,
    )


def menu_button(
    label: object,
    command: str,
    items: Sequence[Item | None],
    *,
    name: str = "",
    hint: str = "",
    kind: str = "",
) -> Html:
    """A button that opens a menu below itself.

    Args:
        label: as in `button`; it should end in "▾".
        command: as in `button`.
        items: the menu's lines; None draws a line between groups.
        name: of the button and its menu for those who do not see it; empty: the label.
        hint: as in `button`.
        kind: as in `button`.
    """
    presses: Presses = {}
    content = json.dumps([_line_of(item, command, "", presses) for item in items], ensure_ascii=False)
    attributes = {"data_tcfit": command, "data_menu": content, "title": hint, "aria_label": name}
    look = f"tcfit-{kind}" if kind else ""
    made = tag("button", tag("span", label), type="button", aria_haspopup="menu", class_=look, **attributes)
    return Html(made, presses)


def _line_of(item: Item | None, command: str, above: str, presses: Presses) -> dict[str, Any] | None:
    """A menu's line as the page takes it (menu.js); what it does is added to `presses`."""
    if item is None:
        return None
    value = f"{above}{item.label}"
    made: dict[str, Any] = {"label": item.label, "keys": item.keys, "obstacle": item.obstacle, "value": value}
    made |= {name: on for name in ("checked", "chosen") if (on := getattr(item, name)) is not None}
    if item.more:
        made["more"] = [_line_of(one, command, f"{value}/", presses) for one in item.more]
    elif not item.obstacle:
        presses[command, value] = item.do
    return made


@cache
def short_keys(keys: tuple[Key, ...]) -> str:
    """The first of an action's keys, abbreviated as on keyboards; empty without any."""
    shown = str(keys[0]) if keys else ""
    for name, sign in _SIGNS.items():
        shown = shown.replace(name, sign)
    return shown


_SIGNS = {"Shift+": "⇧", "Backspace": "⌫"}


def row(*parts: Html, label: str = "", wrap: bool = False) -> Html:
    """Buttons in a row, aligned with viser's inputs if there is a label; with `wrap` on several lines."""
    named = [tag("label", label)] if label else []
    return tag("div", joined(*named, *parts), class_="tcfit-row tcfit-wrap" if wrap else "tcfit-row")


def choice(*buttons: Html) -> Html:
    """Mutually exclusive buttons, joined."""
    return tag("div", joined(*buttons), class_="tcfit-joined")


def heading(title: str, note: object = "", *, first: bool = False) -> Html:
    """A section heading with a note on the right; the first in a panel has no rule above it."""
    return tag("h3", joined(tag("b", title), tag("span", note)), class_="tcfit-first" if first else "")


def paragraph(content: object, kind: str = "") -> Html:
    """Text that keeps its line breaks; `kind` as in `words`, or "warn"."""
    return tag("p", content, class_=f"tcfit-{kind}" if kind else "")


def words(content: object, kind: str) -> Html:
    """A span of text: "good", "bad", "dim" or "strong"."""
    return tag("span", content, class_=f"tcfit-{kind}")


def progress_bar(share: float) -> Html:
    """A progress bar, 0 to 1."""
    return tag("div", tag("div", "", class_="tcfit-bar", style=f"width:{100 * share:.1f}%"), class_="tcfit-track")


def table(rows: Iterable[Html], head: Sequence[str] = (), *, numbers: Sequence[int] = ()) -> Html:
    """Rows made by `line` under a header; the columns of `numbers` are right-aligned."""
    cells = (tag("th", name, class_="tcfit-number" if i in numbers else "") for i, name in enumerate(head))
    return tag("table", joined(*([tag("tr", joined(*cells))] if head else []), *rows), class_="tcfit-table")


def facts(known: Iterable[tuple[str, object]]) -> Html:
    """Names and values side by side."""
    return tag("dl", joined(*(part for name, value in known for part in (tag("dt", name), tag("dd", value)))))


def line(
    *cells: object,
    numbers: Sequence[int] = (),
    whole: Sequence[int] = (),
    kind: str = "",
    press: Html | None = None,
    hint: str = "",
) -> Html:
    """A table's row.

    Args:
        cells: its contents.
        numbers: which cells are right-aligned and do not wrap.
        whole: which others do not wrap.
        kind: "here" or "off".
        press: the `opener` among its cells, for keyboard users, which the row presses too.
        hint: its tooltip.
    """
    looks = dict.fromkeys(whole, "tcfit-whole") | dict.fromkeys(numbers, "tcfit-number")
    made = joined(*(tag("td", cell, class_=looks.get(i, "")) for i, cell in enumerate(cells)))
    command, value = next(iter(press.presses)) if press is not None else ("", "")
    return tag("tr", made, class_=f"tcfit-{kind}" if kind else "", data_tcfit=command, data_value=value, title=hint)


def opener(content: object, command: str, value: str, do: Callable[[], object]) -> Html:
    """A button that looks like text, in a row that does the same when pressed anywhere."""
    made = tag("button", content, type="button", class_="tcfit-open", data_tcfit=command, data_value=value)
    return Html(made, {(command, value): do})


def card(title: str, note: str, command: str, value: str, *, do: Callable[[], object], here: bool, hint: str) -> Html:
    """A button that is an entry of a list: a sentence, and a line about it; `here`: it is the one on show."""
    made = tag(
        "button",
        joined(tag("b", title), tag("span", note)),
        type="button",
        class_="tcfit-entry",
        aria_current="true" if here else "",
        data_tcfit=command,
        data_value=value,
        title=hint,
    )
    return Html(made, {(command, value): do})


class Board:
    """A panel element that shows HTML and sends it only when it changes. Its buttons work while they are shown."""

    def __init__(self, tab: Tab) -> None:
        self._content = ""
        self._buttons, self._handle = tab.buttons, tab.client.gui.add_html("")

    def show(self, *parts: Html) -> None:
        """Show these parts, one below the other; none hides it."""
        content = tag("div", joined(*parts), class_="tcfit-panel") if parts else Html()
        self._buttons.show(self, content.presses)
        if content != self._content:
            self._handle.content = str(content)
            self._content = content


class Strip:
    """HTML around the picture, as `Board` shows it in a panel: the page has a place for it."""

    def __init__(self, tab: Tab, name: Literal["header", "bar"]) -> None:
        self._tab, self._name = tab, name

    def show(self, *parts: Html) -> None:
        """Show these parts in a row, as many each time: the page replaces those that have changed."""
        content = joined(*parts)
        self._tab.buttons.show(self, content.presses)
        self._tab.channel.send(self._name, Markup(html=str(content)))
