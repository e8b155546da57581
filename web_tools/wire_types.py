"""TypeScript's view of what travels between server and page, from the structs themselves.

`python -m web_tools.wire_types` writes it; a test compares.
"""

from pathlib import Path

import msgspec
from msgspec import inspect

from fitting_core.render.colors import COLORS
from tcfit_app.review.browser import page_events, page_states
from tcfit_app.review.browser.page_states import STATES, PageRequest

PATH = Path(__file__).parent / "types" / "wire.d.ts"
_HEAD = """/** What travels between server and page, by page_states.py and page_events.py, which explain everything.
 * Made by `python -m web_tools.wire_types`. */
"""
_PLAIN = {
    inspect.IntType: "number",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
    inspect.NoneType: "null",
}


def wire_types() -> str:
    """The text of wire.d.ts."""
    found = [kind for module in (page_states, page_events) for kind in _structs(module)]
    kinds = [kind for kind in found if kind is not page_states.PageState]
    states = "\n".join(f"  {name}: {kind.__name__};" for name, kind in STATES.items())
    events = " | ".join(kind.__name__ for kind in _structs(page_events) if kind is not page_events.Envelope)
    requests = _type(inspect.type_info(PageRequest))
    parts = [_HEAD, *map(_interface, kinds), f"export interface States {{\n{states}\n}}\n"]
    meanings = " | ".join(f'"{name}"' for name in COLORS)
    unions = [f"export type PageRequest = {requests};\n", f"export type PageEvent =\n  {events};\n"]
    unions.append(f"/** Names of COLORS. */\nexport type Meaning =\n  {meanings};\n")
    return "\n".join([*parts, *unions])


def _structs(module: object) -> list[type[msgspec.Struct]]:
    return [
        kind
        for name, kind in vars(module).items()
        if not name.startswith("_") and isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    ]


def _interface(kind: type[msgspec.Struct]) -> str:
    about = inspect.type_info(kind)
    assert isinstance(about, inspect.StructType)
    tag = [f'  type: "{about.tag}";'] if about.tag is not None else []
    fields = [f"  {field.encode_name}: {_type(field.type)};" for field in about.fields]
    return "\n".join([f"export interface {kind.__name__} {{", *tag, *fields, "}\n"])


def _type(about: inspect.Type) -> str:
    if isinstance(about, inspect.StructType):
        return about.cls.__name__
    if isinstance(about, inspect.LiteralType):
        return " | ".join(f'"{value}"' for value in sorted(about.values, key=str))
    if isinstance(about, inspect.UnionType):
        return " | ".join(map(_type, about.types))
    if isinstance(about, inspect.VarTupleType):
        return f"{_grouped(_type(about.item_type))}[]"
    if isinstance(about, inspect.TupleType):
        return f"[{', '.join(map(_type, about.item_types))}]"
    return _PLAIN[type(about)]


def _grouped(name: str) -> str:
    return f"({name})" if "|" in name else name


if __name__ == "__main__":
    PATH.write_text(wire_types(), encoding="utf-8")
