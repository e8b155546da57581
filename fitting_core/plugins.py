"""Plugins: additions of other installed packages to tcfit's tables, by entry points of Python packages.

A table asks for its group when it is used, so nothing of a plugin is imported before. A fault is reported once,
recorded in `faults`, and never stops tcfit, which continues without that plugin.
"""

import logging
import re
import signal
import threading
from collections.abc import Container, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from importlib import metadata
from typing import Generic, Literal, TypeVar, get_args

Group = Literal["tcfit.readers", "tcfit.exports"]
GROUPS: tuple[Group, ...] = get_args(Group)
_REMOVED = {
    "tcfit.findings": "tcfit no longer has findings from plugins; compute them in an export (tcfit.exports), which "
    "gets the clip and the fit",
    "tcfit.metrics": "tcfit no longer has metrics from plugins; compute them in an export (tcfit.exports), or from "
    "fit.npz in Python",
}
"""Groups of earlier versions, and their replacements."""

FAILURES = (Exception, SystemExit)
"""Exceptions that are a plugin's fault; `sys.exit` is one too."""
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]*")
_log = logging.getLogger(__name__)
Thing = TypeVar("Thing")


@dataclass(frozen=True, kw_only=True)
class Plugin(Generic[Thing]):
    """Something that a package adds."""

    group: str
    name: str
    """In its table: what a user types or reads."""
    package: str
    """Name and version of the package that adds it."""
    thing: Thing

    def reports(self, reason: object) -> str:
        """Report a fault, once, and record it.

        Returns:
            What was said: what, of which package, and what to do.
        """
        fault = Fault(group=self.group, name=self.name, package=self.package, reason=_in_words(reason))
        if fault not in _faults:
            _faults[fault] = None
            _log.warning("%s", fault.text)
        return fault.text


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Fault of a plugin."""

    group: str
    name: str
    package: str
    reason: str

    @property
    def advice(self) -> str:
        """Advice."""
        return f"update the package {self.package}, tell its authors, or uninstall it; all else works"

    @property
    def text(self) -> str:
        """For the user."""
        return f"The plugin {self.name!r} ({self.group}) does not work: {self.reason}. What to do: {self.advice}."

    def of(self, plugin: Plugin) -> bool:
        """Whether it is that plugin's."""
        return (self.group, self.name, self.package) == (plugin.group, plugin.name, plugin.package)


_faults: dict[Fault, None] = {}


def failures() -> tuple[type[BaseException], ...]:
    """Exceptions that are a plugin's fault in this thread. KeyboardInterrupt is one if Ctrl-C cannot raise it, as
    outside the main thread and in processes that ignore the signal."""
    main = threading.current_thread() is threading.main_thread()
    by_ctrl_c = main and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    return FAILURES if by_ctrl_c else (*FAILURES, KeyboardInterrupt)


def faults() -> tuple[Fault, ...]:
    """Faults of plugins so far, without plugins that were not used yet."""
    return tuple(_faults)


def added(group: Group, kind: type[Thing], *others: type, taken: Container[str] = ()) -> dict[str, Plugin[Thing]]:
    """The plugins of a group that are of one kind, by name; what cannot be used is reported and left out.

    Args:
        group: One of GROUPS.
        kind: What they are to be.
        others: Other kinds in the group, which another table takes.
        taken: tcfit's own names, which are reserved.
    """
    found: dict[str, Plugin] = {}
    for plugin in loaded(group):
        if not isinstance(plugin.thing, kind):
            if isinstance(plugin.thing, others):
                continue
            expected = " or ".join(wanted.__name__ for wanted in (kind, *others))
            plugin.reports(f"it is of the type {type(plugin.thing).__name__}; expected {expected}")
        elif wrong := _no_text(plugin.thing):
            plugin.reports(wrong)
        elif plugin.name in taken:
            plugin.reports(f"tcfit itself has {plugin.name!r}; another name is needed")
        elif plugin.name in found:
            plugin.reports(f"{found[plugin.name].package} has taken that name; one of the two must go")
        else:
            found[plugin.name] = plugin
    return found


def _no_text(thing: object) -> str:
    """What of a thing should be a text and is not; empty if all is."""
    texts = [part.name for part in fields(thing) if part.type in (str, "str")] if is_dataclass(thing) else []
    wrong = ((name, value) for name in texts if not isinstance(value := getattr(thing, name), str))
    return next((f"its {name} is of the type {type(value).__name__}; expected a text" for name, value in wrong), "")


@cache
def loaded(group: Group) -> tuple[Plugin[object], ...]:
    """All that a group has and that can be imported, by name and package, so that the order is the same everywhere."""
    for removed, reason in _REMOVED.items():
        for _, plugin in _entry_points(removed):
            plugin.reports(reason)
    found = []
    for point, plugin in _entry_points(group):
        if not _NAME.fullmatch(point.name):
            plugin.reports("its name is not of small letters, digits, hyphens and underscores")
            continue
        try:
            thing = point.load()
        except failures() as error:  # the import of a plugin may raise anything
            plugin.reports(f"{point.value} cannot be imported ({_in_words(error)})")
            continue
        found.append(replace(plugin, thing=thing))
    return tuple(found)


def _entry_points(group: str) -> Iterator[tuple[metadata.EntryPoint, Plugin[object]]]:
    """Those of a group by name and package, each with a plugin that is not imported yet."""
    points = metadata.entry_points(group=group)
    for point in sorted(points, key=lambda point: (point.name, point.dist.name if point.dist else "")):
        package = f"{point.dist.name} {point.dist.version}" if point.dist else "of unknown name"
        yield point, Plugin(group=group, name=point.name, package=package, thing=None)


def forget() -> None:
    """Search for plugins again at the next use, as after an installation."""
    loaded.cache_clear()
    _faults.clear()


def _in_words(reason: object) -> str:
    if not isinstance(reason, BaseException):
        return str(reason)
    try:
        text = str(reason)
    except failures():  # that, too, is a stranger's
        text = ""
    return f"{type(reason).__name__}: {next(iter(text.splitlines()), '')}".rstrip(": .")
