"""The header above the picture: the clip and its review, undo, what is being done or wrong, and who is here."""

from functools import partial

from tcfit_app.review.browser.page_states import SwitchTheme
from tcfit_app.review.drawing.status import Message, Status, notice
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.edit_words import also_here
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
    progress_bar,
    symbol,
    tag,
    worded,
)

_EMPTY = tag("span", "")


class Header:
    """Draws one tab's header; called repeatedly, it sends only changes."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab, self.status = gestures, gestures.tab, Status(gestures)
        self._action, self._item = partial(action, gestures), partial(action_item, gestures)
        self._strip = Strip(gestures.tab, "header")

    def draw(self, now: float, problem: str) -> None:
        """Send what changed; `problem` as in `Status.messages`."""
        tab = self._tab
        tab.channel.send("notice", notice(tab))
        self._strip.show(
            self._action("list", worded("chevron-left", "All clips")) if tab.in_list else _EMPTY,
            tag("h1", tab.session.project.footage.name),
            self._review(),
            choice(self._action("undo", symbol("arrow-back-up")), self._action("redo", symbol("arrow-forward-up"))),
            self._status(self.status.messages(now, problem)),
            self._person(),
            self._others(),
            menu_button(symbol("help"), "header.help", self._help(), name="Help", hint="Help"),
        )

    def _review(self) -> Html:
        by, names = self._gestures.reviewing.approved, ("next_clip", "previous_clip", "list")
        items: list[Item | None] = [self._item("approve", "Withdraw approval" if by else "Approve clip")]
        if self._tab.in_list:
            items += [None, *map(self._item, names)]
        hint = f"Approved by {by}" if by else "Not approved yet"
        return menu_button(f"{'Approved' if by else 'In review'} ▾", "header.review", items, hint=hint)

    def _status(self, messages: list[Message]) -> Html:
        """The first that is in progress, and the first that is not; the others in a menu."""
        busy = [message for message in messages if message.cancel is not None or message.kind == "busy"]
        rest = [message for message in messages if message not in busy]
        shown = [*busy[:1], *rest[:1]]
        more: list[Item | None] = [
            Item(label=one.text, do=partial(self._lead, one)) for one in messages if one not in shown
        ]
        parts = [self._message(message) for message in shown]
        if more:
            parts.append(menu_button(f"{len(more)} more ▾", "header.more", more, hint="More messages"))
        saved = tag("span", "Saved", class_="tcfit-dim tcfit-saved", title="Every change is saved at once")
        return tag("div", joined(*parts or [saved]), class_="tcfit-status", role="status")

    def _message(self, message: Message) -> Html:
        said = tag("span", message.text, title=". ".join(filter(None, (message.text, message.hint))))
        if message.panel:
            said = button(
                message.text, "header.lead", message.panel, do=partial(self._lead, message), hint=message.hint
            )
        parts = [said]
        if message.progress is not None:
            parts.insert(0, progress_bar(message.progress))
        if message.cancel is not None:  # first: words that grow would move it under the pointer
            parts.insert(0, button("Cancel", "header.cancel", message.text.split()[0], do=message.cancel))
        return tag("div", joined(*parts), class_=f"tcfit-message tcfit-{message.kind}")

    def _lead(self, message: Message) -> None:
        """Show where something can be done about a message."""
        if message.panel:
            self._tab.show_panel(message.panel)

    def _person(self) -> Html:
        here, people = self._tab.someone, self._tab.someone.all_people
        if len(people) < 2:
            return _EMPTY
        items: list[Item | None] = [
            Item(label=one.name, do=partial(self._tab.go_to, one), chosen=one is here) for one in people
        ]
        label = f"{here.name[:1].upper()}{here.name[1:]} of {len(people)} ▾"
        return menu_button(
            label, "header.person", items, hint="The person to correct and fit; the others are dimmed. Q: next person"
        )

    def _others(self) -> Html:
        tab = self._tab
        words = also_here(tab.authors(), tab.author)
        return (
            tag("span", joined(symbol("users"), tag("span", words)), class_="tcfit-others", title=words)
            if words
            else _EMPTY
        )

    def _help(self) -> list[Item | None]:
        theme = Item(label="Light or dark theme", do=lambda: self._tab.channel.ask(SwitchTheme()))
        return [self._item("help", "Keys"), self._item("first_steps", "First steps"), theme]
