"""All keys of scenario files as Markdown: `python -m analysis.settings_reference > docs/settings.md`."""

import dataclasses
import types
import typing
from collections.abc import Iterator
from typing import Any

import annotated_types
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from camera_synth.condition import PRESETS, preset_settings
from plugin.configuration import Configuration

_HEADER = """# Settings

Generated from the settings classes by `python -m analysis.settings_reference > docs/settings.md`.

Every key of a scenario file, with its default. A section is a TOML table: `[departure]` and then
`threshold_s = 1.2`, or `departure.threshold_s = 1.2` at the top. The same names go into a campaign's
`[grid]`, a regression's `[settings]` and `DriverAssistance.attach(settings=…)`. Units are in the names; left
is positive. A value out of bounds, or an unknown key, gives a one-line error that says what is allowed.
"""
_LIMITS = {
    annotated_types.Gt: (">", "gt"),
    annotated_types.Ge: ("≥", "ge"),
    annotated_types.Lt: ("<", "lt"),
    annotated_types.Le: ("≤", "le"),
}


def reference() -> str:
    """The Markdown text."""
    parts = [_HEADER, "\n## Top level\n\n", *_table(Configuration, "")]
    for name, cls, entries in _sections(Configuration, ""):
        heading = f"[[{name}]]" if entries else f"[{name}]"
        text = (cls.__doc__ or "").strip().split("\n\n")[0].replace("\n", " ")
        level = "###" if "." in name else "##"
        parts += [f"\n{level} `{heading}`\n\n", f"{' '.join(text.split())}\n\n", *_table(cls, name)]
        if name == "condition":
            parts += _presets()
    return "".join(parts)


def _fields(cls: Any) -> dict[str, FieldInfo]:
    fields: dict[str, FieldInfo] = cls.__pydantic_fields__
    return fields


def _nested(annotation: Any) -> tuple[Any, bool]:
    """The settings class in an annotation, if any, and whether the key holds several of them."""
    if dataclasses.is_dataclass(annotation):
        return annotation, False
    if typing.get_origin(annotation) is tuple:
        inner = typing.get_args(annotation)[0]
        if dataclasses.is_dataclass(inner):
            return inner, True
        if isinstance(inner, types.UnionType) or typing.get_origin(inner) is typing.Union:
            for one in typing.get_args(inner):
                if dataclasses.is_dataclass(one):
                    return one, True
    return None, False


def _sections(cls: Any, prefix: str) -> Iterator[tuple[str, Any, bool]]:
    for name, field in _fields(cls).items():
        inner, entries = _nested(field.annotation)
        if inner is not None:
            yield f"{prefix}{name}", inner, entries
            yield from _sections(inner, f"{prefix}{name}.")


def _table(cls: Any, section: str) -> list[str]:
    rows = [_row(name, field) for name, field in _fields(cls).items() if _nested(field.annotation)[0] is None]
    below = [
        f"[`{name}`](#{_anchor(section, name, entries)})"
        for name, field in _fields(cls).items()
        for inner, entries in (_nested(field.annotation),)
        if inner is not None
    ]
    parts = ["| key | type | default | allowed | meaning |\n|---|---|---|---|---|\n", *rows] if rows else []
    if below:
        parts.append(f"\nTables of their own: {', '.join(below)}.\n" if rows else f"{', '.join(below)}\n")
    return parts


def _anchor(section: str, name: str, entries: bool) -> str:
    # like heading ids of Python-Markdown and GitHub: lower case, no dots and brackets
    return f"{section}.{name}".replace(".", "").lower() if section else name


def _row(name: str, field: FieldInfo) -> str:
    cells = (f"`{name}`", _type(field.annotation), _default(field), _allowed(field), field.description or "")
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |\n"


def _type(annotation: Any) -> str:
    origin, args = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Annotated:
        return _type(args[0])
    if origin is typing.Literal:
        return "choice"
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type(arg) for arg in args if arg is not type(None)))
    if origin is tuple:
        if len(args) == 2 and args[1] is Ellipsis:
            return f"list of {_type(args[0])}"
        return f"list of {len(args)} {_type(args[0])}" if len(set(args)) == 1 else "list"
    known = {float: "number", int: "whole number", bool: "true or false", str: "text"}
    return known.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _default(field: FieldInfo) -> str:
    value = field.get_default(call_default_factory=True, validated_data={})
    if value is PydanticUndefined:
        return "must be given"
    if value is None:
        return "none"
    return f"`{_toml(value)}`"


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    if isinstance(value, str):
        return f'"{value}"'
    return str(value).lower() if isinstance(value, bool) else _number(value)


def _number(value: float) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _allowed(field: FieldInfo) -> str:
    choices = _choices(field.annotation)
    if choices:
        return ", ".join(f"`{choice}`" for choice in choices)
    parts = [
        f"{sign} {_number(getattr(limit, name))}"
        for kind, (sign, name) in _LIMITS.items()
        for limit in _limits(field)
        if isinstance(limit, kind)
    ]
    parts += [f"at least {m.min_length}" for m in field.metadata if isinstance(m, annotated_types.MinLen)]
    parts += [f"at most {m.max_length}" for m in field.metadata if isinstance(m, annotated_types.MaxLen)]
    return ", ".join(parts)


def _limits(field: FieldInfo) -> list[Any]:
    """Limits of the key itself, or of a list's entries or an optional number."""
    found = list(field.metadata)
    pending = [field.annotation]
    while pending:
        annotation = pending.pop()
        if typing.get_origin(annotation) is typing.Annotated:
            for limit in typing.get_args(annotation)[1:]:
                found += limit.metadata if isinstance(limit, FieldInfo) else [limit]
        pending += [arg for arg in typing.get_args(annotation) if typing.get_origin(annotation) is not None]
    return list(dict.fromkeys(found))  # duplicates, as for both numbers of a pair, once


def _choices(annotation: Any) -> tuple[Any, ...]:
    if typing.get_origin(annotation) is typing.Literal:
        return typing.get_args(annotation)
    for arg in typing.get_args(annotation):
        found = _choices(arg)
        if found:
            return found
    return ()


def _presets() -> list[str]:
    parts = [
        '\n`preset = "NAME"` sets these; further keys override them. Short: `condition = "NAME"`.\n\n'
        "| preset | sets |\n|---|---|\n"
    ]
    for name in PRESETS:
        values = ", ".join(f"`{key} = {_toml(value)}`" for key, value in preset_settings(name).items())
        parts.append(f"| `{name}` | {values or 'nothing'} |\n")
    return parts


if __name__ == "__main__":
    print(reference(), end="")
