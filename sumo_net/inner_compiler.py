"""Compiles kernels that other kernels call, only to LLVM's intermediate code, which goes into the callers.

numba would also translate it to machine code, which is never run. It is optimised here all the same: linked
in as generated, with all its reference counting, it would make the caller slow.

What is overridden here is not documented by numba. If a version of numba lacks any of it, this module raises
ImportError and `compile` uses numba's own compiler.
"""

from typing import Any

import numba
from numba.core.base import BaseContext
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompileResult
from numba.core.cpu import CPUContext
from numba.core.pythonapi import EnvironmentManager, PythonAPI

from sumo_net.borrowed_arrays import BorrowingCompiler
from sumo_net.checked_arguments import CheckingCompiler

_USED: dict[type, tuple[str, ...]] = {
    JITCodeLibrary: ("_finalize_final_module", "_finalize_dynamic_globals", "_finalized", "codegen"),
    JITCPUCodegen: ("set_env",),
    BorrowingCompiler: ("compile_extra",),
    CPUContext: ("get_python_api",),
    PythonAPI: (
        "unpack_tuple",
        "get_env_manager",
        "to_native_value",
        "from_native_value",
        "serialize_object",
        "unserialize",
        "numba_array_adaptor",
        "nrt_adapt_ndarray_from_python",
    ),
    EnvironmentManager: ("add_const", "read_const"),
    BaseContext: ("subtarget", "enable_nrt"),
    CompileResult: ("_find_referenced_environments", "codegen"),
}
for _owner, _names in _USED.items():
    for _name in _names:
        if not hasattr(_owner, _name):
            raise ImportError(f"numba {numba.__version__} has no {_owner.__name__}.{_name}")


class _InnerLibrary(JITCodeLibrary):
    """A library that is linked into others and not executed itself."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """The object on which numba calls `set_env`; environments exist only in machine code."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        """Does nothing; `OuterCompiler` sets the environments."""


class InnerCompiler(BorrowingCompiler):
    """The compiler of kernels that are called by other kernels."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        if self.state.library is None:
            self.state.library = _InnerLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class OuterCompiler(CheckingCompiler):
    """The compiler of kernels that are called from Python and may contain those of InnerCompiler."""

    def compile_extra(self, func: Any) -> Any:
        """Compile the function."""
        result = super().compile_extra(func)
        # as numba does for what it loads: messages and prints of inner kernels read their values there
        for env in result._find_referenced_environments():
            result.codegen.set_env(env.env_name, env)
        return result
