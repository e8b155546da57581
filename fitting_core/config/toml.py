"""Configurations as files: read from TOML, written as TOML with comments, and as plain data for JSON."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from fitting_core.config.schema import DEFAULT_PRESET, PRESETS, FitConfig
from fitting_core.config.settings import NONE, changed, groups, nearest, settings, unknown, value_of
from fitting_core.errors import InputError
from fitting_core.files.regular import StrPath, parsed_toml, regular_file

_MAX_BYTES = 2**20


def preset(name: str, *, origin: str = "--preset") -> FitConfig:
    """The preset of this name. Raises InputError if there is no such preset."""
    if name not in PRESETS:
        near = nearest(name, list(PRESETS)) if isinstance(name, str) else []
        hint = f" Did you mean {near[0]}?" if near else ""
        raise InputError(f"{origin}: there is no preset {name!r}; expected one of {', '.join(PRESETS)}.{hint}")
    return PRESETS[name]


def read_config(path: StrPath, *, preset_name: str | None = None) -> FitConfig:
    """The configuration of `read_named`, without the name of its preset."""
    path = Path(path)
    return read_named(path, preset_name=preset_name)[1]


def read_named(path: Path, *, preset_name: str | None = None) -> tuple[str, FitConfig]:
    """Read a configuration: `preset = "..."` and any fields of FitConfig, those of its parts in tables.

    Args:
        path: TOML file.
        preset_name: Use this preset and not the file's own (which is DEFAULT_PRESET where it names none).

    Returns:
        The preset that it starts from, and the configuration.

    Raises:
        InputError: The file cannot be read, or holds an unknown name or a wrong value.
    """
    try:
        text = regular_file(path, most=_MAX_BYTES).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}). Give a configuration in TOML.") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text. Give a configuration in TOML.") from error
    return parsed(text, origin=path.name, preset_name=preset_name)


def parsed(text: str, *, origin: str, preset_name: str | None = None) -> tuple[str, FitConfig]:
    """The preset that a configuration in TOML starts from, and the configuration. Raises InputError if it is not TOML,
    or holds an unknown name or a wrong value.

    Args:
        text: What `read_config` reads.
        origin: Where it stands, for messages.
        preset_name: Use this preset and not the text's own.
    """
    try:
        table = parsed_toml(text)
    except ValueError as error:
        raise InputError(f"{origin}: is not TOML ({error}). `tcfit settings` prints a file to start from.") from error
    name = table.pop("preset", DEFAULT_PRESET)
    base = preset(name, origin=origin)
    if preset_name is not None:
        name, base = preset_name, preset(preset_name)
    return name, changed(base, dict(_flat(table, "", origin)), origin=origin)


def _flat(table: dict[str, Any], prefix: str, origin: str) -> Iterator[tuple[str, Any]]:
    """Values by dotted name; groups must be tables and settings must not."""
    for key, value in table.items():
        name = prefix + key
        if name in groups():
            if not isinstance(value, dict):
                raise InputError(f"{origin}: {name} is a group of settings; expected a table [{name}] with them.")
            yield from _flat(value, f"{name}.", origin)
        elif isinstance(value, dict) and name not in settings():
            raise InputError(f"{origin}: {unknown(name, [*groups(), *settings()])}")
        else:
            yield name, value


def as_plain(config: FitConfig) -> dict[str, Any]:
    """The configuration as nested dicts, lists, numbers and texts, as JSON has them."""
    return msgspec.to_builtins(asdict(config))


def as_toml(config: FitConfig, *, preset_name: str) -> str:
    """A TOML file with every setting and what it means; `read_config` reads the same configuration from it."""
    lines = ["# Any line may be left out: the preset's value counts then.", f'preset = "{preset_name}"']
    group = ""
    # TOML's own fields must stand before its tables.
    for setting in sorted(settings().values(), key=lambda s: s.group != ""):
        if setting.group != group:
            group = setting.group
            lines += ["", f"[{group}]", f"# {groups()[group]}"]
        value = _toml_value(value_of(config, setting.name))
        lines += ["", f"# {setting.doc or setting.expected}", f"{setting.name.rpartition('.')[2]} = {value}"]
    return "\n".join(lines) + "\n"


def _toml_value(value: Any) -> str:
    return msgspec.json.encode(NONE if value is None else value).decode().replace(",", ", ")
