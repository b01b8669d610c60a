"""Settings: frozen dataclasses checked on construction and read from TOML.

`@settings` makes a pydantic dataclass that is frozen and refuses unknown keys. `read` builds one from a
mapping; its error has one line per finding with the key, the value and what is allowed, and for an unknown
key the nearest known one.
"""

import dataclasses
import difflib
import json
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, dataclass_transform, get_args

import pydantic
import pydantic.dataclasses

T = TypeVar("T")
N = TypeVar("N", bound=tuple[Any, ...])

_MOST_FINDINGS = 20  # that are told
_LONGEST_VALUE = 300  # and of a message as a whole:
_LONGEST = 8000
_DEEPEST = 50  # tables and lists within each other
_TABLE = "must be a table"
_TOML_WORDS = {"tuple_type": "must be a list", "dict_type": _TABLE, "dataclass_type": _TABLE}
_CONFIG = pydantic.ConfigDict(extra="forbid", arbitrary_types_allowed=False, allow_inf_nan=False)


class InputError(ValueError):
    """Faulty user input. Control characters in the message are escaped."""

    def __init__(self, message: str) -> None:
        if len(message) > _LONGEST:
            message = f"{message[:_LONGEST]} …"
        super().__init__("".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in message))


class SettingsError(InputError):
    """Faulty settings; one line per finding."""


@dataclass_transform(frozen_default=True, kw_only_default=True)
def settings(cls: type[T]) -> type[T]:
    """Class decorator: a frozen, keyword-only dataclass, checked on construction, unknown keys refused."""
    decorate: Callable[[type[T]], Any] = pydantic.dataclasses.dataclass(
        frozen=True, kw_only=True, config=_CONFIG
    )
    made: type[T] = decorate(cls)
    return made


def read(cls: type[T], mapping: Mapping[str, Any], source: str) -> T:
    """Build `cls` from a (nested) mapping.

    Raises SettingsError that names `source`, the dotted key, the value and what is allowed.
    """
    if not isinstance(mapping, Mapping):
        raise SettingsError(f"{source}: {str(mapping)[:80]!r}: must be a table of settings")
    try:
        return pydantic.TypeAdapter(cls).validate_python(dict(mapping))
    except pydantic.ValidationError as error:
        errors = error.errors(include_url=False)
        lines = [_finding(cls, finding) for finding in errors[:_MOST_FINDINGS]]
        if len(errors) > _MOST_FINDINGS:
            lines.append(f"and {len(errors) - _MOST_FINDINGS} more")
        raise SettingsError("\n".join(f"{source}: {line}" for line in lines)) from None


def kernel_view(form: type[N], settings: Any, **others: Any) -> N:
    """`form`, a NamedTuple that kernels take: `others`, and the settings that have the names of its fields.

    A field that is neither keeps its default.
    """
    kept: Any = form
    names = [name for name in kept._fields if name not in others and name not in kept._field_defaults]
    return form(**{name: getattr(settings, name) for name in names}, **others)


def read_toml(path: Path) -> dict[str, Any]:
    """The mapping in a TOML file. Raises SettingsError if it cannot be read or is not TOML."""
    try:
        with path.open("rb") as file:
            return _not_too_deep(tomllib.load(file), path)
    except FileNotFoundError:
        raise SettingsError(f"{path}: no such file") from None
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from None
    except RecursionError:
        raise _too_deep(path) from None
    except SettingsError:
        raise
    except ValueError as error:  # syntax, encoding, or a number of thousands of digits
        raise SettingsError(f"{path}: is not valid TOML: {error}") from None


def read_json(path: Path) -> dict[str, Any]:
    """The mapping in a JSON file. Raises SettingsError if it cannot be read or has no mapping at its top."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise SettingsError(f"{path}: no such file") from None
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from None
    except RecursionError:
        raise _too_deep(path) from None
    except ValueError as error:
        raise SettingsError(f"{path}: is not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise SettingsError(f"{path}: must contain a mapping")
    return _not_too_deep(content, path)


def _not_too_deep(content: dict[str, Any], path: Path) -> dict[str, Any]:
    """The content itself. Raises SettingsError where it is nested too deeply for recursive readers."""
    level: list[Any] = [content]
    for _ in range(_DEEPEST):
        level = [
            inner
            for outer in level
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, dict | list)
        ]
        if not level:
            return content
    raise _too_deep(path)


def _too_deep(path: Path) -> SettingsError:
    return SettingsError(f"{path}: is nested more than {_DEEPEST} deep")


def _finding(cls: Any, finding: Any) -> str:
    location = [str(part) for part in finding["loc"] if not str(part).startswith("<")]  # a union's tag
    key = ".".join(location)
    if finding["type"] == "unexpected_keyword_argument":
        known = _fields_at(cls, location[:-1])
        near = difflib.get_close_matches(location[-1], known, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"known are: {', '.join(sorted(known))}"
        return f"unknown key '{key}': {hint}"
    if finding["type"] == "missing":
        what = _fields_at(cls, location[:-1])[location[-1]]
        return f"{key}: is missing{f' ({what})' if what else ''}"
    message = _TOML_WORDS.get(finding["type"], finding["msg"].removeprefix("Value error, "))
    if not location:
        return str(message)
    return f"{key} = {_short(finding['input'])}: {message[:1].lower()}{message[1:]}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]} …"


def _fields_at(cls: Any, path: list[str]) -> dict[str, str]:
    """The settings at a place and what they are, '' where nothing is said."""
    for part in path:
        if part.isdigit():  # an entry of a tuple of settings
            cls = next(iter(get_args(cls)), cls)
        elif dataclasses.is_dataclass(cls):
            types = {field.name: field.type for field in dataclasses.fields(cls)}
            cls = types.get(part, cls)
    fields = getattr(cls, "__pydantic_fields__", {})
    return {name: field.description or "" for name, field in fields.items()}
