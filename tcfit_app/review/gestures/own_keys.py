"""The keys of commands: those of ACTIONS, and those that the user chose instead, for all projects, in a file of the
user's data folder."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import platformdirs

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.files.regular import regular_file
from fitting_core.files.toml_text import parsed_toml
from tcfit_app.review.browser.page_states import KeyBinding
from tcfit_app.review.gestures.actions import ACTIONS, NAMES, Key

_MOST_BYTES = 2**20
_CODES = {
    **{name.lower(): name for name in ("Space", "Backspace", "Delete", "Insert", "Home", "End", "PageUp", "PageDown")},
    **{name.lower(): name for name in (*NAMES, *(f"F{number}" for number in range(1, 13)))},
    **{shown.lower(): name for name, shown in NAMES.items()},
    **{str(digit): f"Digit{digit}" for digit in range(10)},
}
"""Names of keys with a fixed position, in lower case, as browsers have them."""
_BROWSERS = {Key(key=letter, ctrl=True, shift=shift): "the browser" for letter in "nqtw" for shift in (False, True)}
_KEPT = _BROWSERS | {key: "Commands" for key in (Key(key="k", ctrl=True), Key(key="p", ctrl=True, shift=True))}
"""Keys that never reach the app, and who has them."""


@dataclass(frozen=True)
class _Chosen:
    """What the file has."""

    own: Mapping[str, tuple[Key, ...]] = field(default_factory=dict)
    """By the name of an action."""
    problem: str = ""
    """Why the file is not used."""

    @cached_property
    def keys(self) -> dict[str, tuple[Key, ...]]:
        """Of all actions."""
        return {name: action.keys for name, action in ACTIONS.items()} | dict(self.own)

    @cached_property
    def bindings(self) -> tuple[KeyBinding, ...]:
        return tuple(
            KeyBinding(key=key.key, action=name, shift=key.shift, ctrl=key.ctrl, held=ACTIONS[name].held)
            for name, keys in self.keys.items()
            for key in keys
        )


def own_keys_file() -> Path:
    """Where they are; it may not exist yet."""
    return platformdirs.user_data_path("tcfit", appauthor=False) / "keys.toml"


def keys_of(action: str) -> tuple[Key, ...]:
    """The keys of one of ACTIONS, by its name."""
    return _chosen().keys[action]


def key_text(action: str) -> str:
    """The same in words; empty without any."""
    return " or ".join(map(str, keys_of(action)))


def bindings() -> tuple[KeyBinding, ...]:
    """All keys, in the page's form."""
    return _chosen().bindings


def keys_problem() -> str:
    """Why the user's own keys are not used; empty if they are."""
    return _chosen().problem


def change_keys(action: str, text: str | None) -> None:
    """Give one of ACTIONS other keys, in all projects.

    Args:
        action: Its name.
        text: As `keys_from` reads it; None: the usual ones.

    Raises:
        InputError: There is no such key, another command has it, or the file cannot be read or written, which leaves it
            as it is.
    """
    chosen = _chosen()
    if chosen.problem:
        raise InputError(chosen.problem)
    keys = ACTIONS[action].keys if text is None else keys_from(text)
    own = {name: each for name, each in {**chosen.own, action: keys}.items() if each != ACTIONS[name].keys}
    _refuse_conflicts(_Chosen(own).keys, action)
    path = own_keys_file()
    texts = {name: " ".join(map(str, each)) for name, each in own.items()}
    lines = (f"{json.dumps(name)} = {json.dumps(text, ensure_ascii=False)}\n" for name, text in texts.items())
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as draft:
            draft.write_text("".join(lines), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: your keys cannot be written ({error}). Nothing was changed.") from error


def keys_from(text: str) -> tuple[Key, ...]:
    """The keys written as "D", "Ctrl+Shift+Z", "F2" or "Backspace Delete"; none for an empty text.

    Raises:
        InputError: One of them is no key, or never reaches the app.
    """
    return tuple(map(_key_from, text.split()))


def _key_from(text: str) -> Key:
    held, _, name = (text[:-2], "", "+") if text == "+" or text.endswith("++") else text.rpartition("+")
    modifiers = {word.lower() for word in held.split("+") if word}
    code = _CODES.get(name.lower(), name.lower() if len(name) == 1 and name.isascii() and name.isprintable() else "")
    if not code or not modifiers <= {"shift", "ctrl"}:
        raise InputError(f"{text!r} is no key. Write it like D, Shift+D, Ctrl+Shift+D, 5, F2, Space or PageDown.")
    key = Key(key=code, shift="shift" in modifiers, ctrl="ctrl" in modifiers)
    if key.shift and len(code) == 1 and not code.isalnum():
        raise InputError(f"{text!r} is no key: write the sign that Shift gives, like ? or *.")
    if key in _KEPT:
        raise InputError(f"{key} never reaches tcfit: {_KEPT[key]} has it. Choose another key.")
    return key


def _refuse_conflicts(keys: Mapping[str, tuple[Key, ...]], changed: str = "") -> None:
    """Raise InputError if two commands have one key; the one that was changed is named last."""
    owner: dict[Key, str] = {}
    for name in sorted(keys, key=lambda name: name == changed):
        for key in keys[name]:
            if (other := owner.setdefault(key, name)) != name:
                one, two = ACTIONS[other].title, ACTIONS[name].title
                raise InputError(f'{key} is the key of "{one}". Give that another key before "{two}" gets this one.')


def _chosen() -> _Chosen:
    path = own_keys_file()
    try:
        known = path.stat()
    except FileNotFoundError:
        return _USUAL
    except OSError as error:
        return _Chosen(problem=_unusable(path, error))
    return _read(path, known.st_mtime_ns, known.st_size)


_USUAL = _Chosen()


@lru_cache(maxsize=1)  # buttons ask each time they are drawn
def _read(path: Path, changed: int, size: int) -> _Chosen:
    try:
        stored = parsed_toml(regular_file(path, most=_MOST_BYTES).read_text(encoding="utf-8"))
        own = {name: _own(name, text) for name, text in stored.items()}
        chosen = _Chosen(own)
        _refuse_conflicts(chosen.keys)
    except (OSError, ValueError, InputError) as error:
        return _Chosen(problem=_unusable(path, error))
    return chosen


def _own(name: str, text: object) -> tuple[Key, ...]:
    if name not in ACTIONS:
        raise InputError(f"there is no command {name!r}")
    if not isinstance(text, str):
        raise InputError(f"{name} = {text!r} is no text")
    return keys_from(text)


def _unusable(path: Path, error: Exception) -> str:
    return f"{path}: your keys cannot be used ({error}). Mend the file, or delete it; until then the usual keys count."
