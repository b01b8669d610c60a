"""Compiling what only other kernels call: up to LLVM's intermediate code, which goes into the callers.

numba would translate it to machine code as well, which nobody runs. It is optimised here all the same: what
comes into a caller as it was written, with all its counts of references, makes that slow.
"""

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


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
        """Nothing."""


class InnerCompiler(Compiler):
    """numba's compiler, but for where the code goes."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        if self.state.library is None:
            self.state.library = _InnerLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)
