"""Dependencies of a compiled kernel besides its own file: kernels that it calls, and constants that it names.

numba checks only a kernel's own file, and would use stale code of kernels in other files.
"""

import functools
import os
from types import CodeType, FunctionType
from typing import Any

Part = tuple[Any, ...]

_CONSTANTS = (bool, int, float, str, tuple)


def parts(function: FunctionType) -> tuple[Part, ...]:
    """(module, mtime, bytes) of the files of all kernels called within `function`, and (module, name, value)
    of the globals that they use: constants, and the fields of NamedTuples. Sorted.
    """
    found: set[Part] = set()
    seen: set[FunctionType] = set()
    waiting = [function]
    while waiting:
        one = waiting.pop()
        if one not in seen:
            seen.add(one)
            called, own = _direct(one)
            found |= own
            waiting += called
    return tuple(sorted(found, key=repr))


@functools.cache
def _direct(function: FunctionType) -> tuple[tuple[FunctionType, ...], frozenset[Part]]:
    called: list[FunctionType] = []
    named: set[Part] = {(function.__module__, *stamp(function.__code__.co_filename))}
    for name in _names(function.__code__):
        value = function.__globals__.get(name)
        inner = getattr(value, "py_func", getattr(value, "_defn", None))  # of a kernel or an intrinsic
        if isinstance(inner, FunctionType):
            called.append(inner)
        elif isinstance(value, _CONSTANTS):
            named.add((function.__module__, name, repr(value)))
        elif isinstance(value, type) and hasattr(value, "_fields"):
            named.add((function.__module__, name, repr(value._fields)))
    return tuple(called), frozenset(named)


def _names(code: CodeType) -> set[str]:
    """The global names in a code object and in those nested in it."""
    return set(code.co_names).union(*(_names(one) for one in code.co_consts if isinstance(one, CodeType)))


@functools.cache
def stamp(file: str) -> tuple[float, int]:
    """(mtime, bytes) of a file when this process first asked for it."""
    try:
        status = os.stat(file)
    except OSError:  # code from an archive, or entered interactively
        return 0.0, 0
    return status.st_mtime, status.st_size
