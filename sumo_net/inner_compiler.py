"""Compiling what only other kernels call: up to LLVM's intermediate code, which goes into the callers.

numba would translate it to machine code as well, which nobody runs. It is optimised here all the same: what
comes into a caller as it was written, with all its counts of references, makes that slow.

What is overridden here numba does not document. Where it lacks any of it, this cannot be imported, and
`compile` leaves everything to numba's own compiler.
"""

from typing import Any

import numba
from numba.core.base import BaseContext
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompileResult

from sumo_net.borrowed_arrays import BorrowingCompiler

_USED: dict[type, tuple[str, ...]] = {
    JITCodeLibrary: ("_finalize_final_module", "_finalize_dynamic_globals", "_finalized", "codegen"),
    JITCPUCodegen: ("set_env",),
    BorrowingCompiler: ("compile_extra",),
    BaseContext: ("subtarget", "enable_nrt"),
    CompileResult: ("_find_referenced_environments", "codegen"),
}
for _owner, _names in _USED.items():
    for _name in _names:
        if not hasattr(_owner, _name):
            raise ImportError(f"numba {numba.__version__} has no {_owner.__name__}.{_name}")


class _InnerLibrary(JITCodeLibrary):
    """A library that is linked into others, and not run."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """What numba tells the environment to, which has a place in machine code alone."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        """Nothing: `OuterCompiler` does."""


class InnerCompiler(BorrowingCompiler):
    """numba's compiler, but for where the code goes and the counts."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        if self.state.library is None:
            self.state.library = _InnerLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class OuterCompiler(BorrowingCompiler):
    """numba's compiler, for what is called from Python and may call what InnerCompiler made."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        result = super().compile_extra(func)
        # as numba does for what it loads: inner kernels' messages and prints take their values from there
        for env in result._find_referenced_environments():
            result.codegen.set_env(env.env_name, env)
        return result
