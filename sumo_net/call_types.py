"""Types of calls are worked out once: numba's own functions, which all kernels call with the same few types.

For `a + b` numba tries some thirty implementations one after the other, and again wherever it stands, each
time that it goes through a kernel, and when it makes the code: a seventh of the lane tracker's compiling.
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
    """numba's compiler, which asks once what a call of one of numba's functions gives."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        with _remembering():
            return super().compile_extra(func)


@contextlib.contextmanager
def _remembering() -> Iterator[None]:
    # for as long as a kernel is compiled, alone: numba holds a lock; others may compile in this process, too
    function: Any = types.Function
    before = function.get_call_type
    function.get_call_type = _signature
    try:
        yield
    finally:
        function.get_call_type = before


def _signature(function: Any, context: Any, args: Any, kws: Any) -> Any:
    # whatever else is registered for a function later makes it another type
    call = function, context, args, tuple(kws.items()), _inherited(ConfigStack().top())
    signature = _signatures.get(call)
    if signature is None:
        signature = _signatures[call] = _ask(function, context, args, kws)
    return signature


def _inherited(flags: Any) -> tuple[Any, ...]:
    """Of a kernel's flags those that hold for what numba compiles for its calls, too."""
    return flags.nrt, flags.error_model, flags.forceinline, frozenset(flags.fastmath.flags)
