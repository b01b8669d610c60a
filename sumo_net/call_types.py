"""Remembers the types of calls of numba's own functions, which all kernels call with the same few types.

For each `a + b` numba tries some thirty implementations one after the other, in every pass over a kernel and
again when it generates code: a seventh of the lane tracker's compilation time.
"""

import contextlib
from collections.abc import Iterator
from typing import Any

from numba.core import types
from numba.core.compiler import Compiler
from numba.core.targetconfig import ConfigStack

_ask: Any = types.Function.get_call_type
_signatures: dict[Any, Any] = {}


class RememberingCompiler(Compiler):
    """numba's compiler, which resolves the type of each call of one of numba's functions only once."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        with _remembering():
            return super().compile_extra(func)


@contextlib.contextmanager
def _remembering() -> Iterator[None]:
    # only while a kernel is compiled, since other code in this process may compile, too; numba holds a lock
    function: Any = types.Function
    before = function.get_call_type
    function.get_call_type = _signature
    try:
        yield
    finally:
        function.get_call_type = before


def _signature(function: Any, context: Any, args: Any, kws: Any) -> Any:
    # safe to keep: a function for which more is registered later is another type
    call = function, context, args, tuple(kws.items()), _inherited(ConfigStack().top())
    signature = _signatures.get(call)
    if signature is None:
        signature = _signatures[call] = _ask(function, context, args, kws)
    return signature


def _inherited(flags: Any) -> tuple[Any, ...]:
    """A kernel's flags that also apply to what numba compiles for its calls."""
    return flags.nrt, flags.error_model, flags.forceinline, frozenset(flags.fastmath.flags)
