"""The one way in which this project compiles: cached numba kernels that release the GIL.

Kernels take arrays over the fleet, as plain arrays or as NamedTuples of arrays, and loop over the
vehicles inside. Threads, where they help, each get a slice of the fleet.

The cache is beside the code, or, where that cannot be written, in the user's own cache folder. It is never a
reason to fail: what is broken in it is compiled anew, and so is what calls a kernel that has changed, and
everything where the way of compiling has.

A kernel that another one calls is compiled into it, so there it is compiled without a way in from Python and
is not kept on disk by itself (`inner_compiler`).

Vectors are as wide as the processor's: LLVM holds on to half of AVX-512's width, since the first processors
that had it slowed down under it.
"""

import contextlib
import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import codegen
from numba.core.caching import FunctionCache, IndexDataCacheFile

from sumo_net.kernel_sources import parts, stamp

try:
    from sumo_net.inner_compiler import InnerCompiler, OuterCompiler
except ImportError:  # of another numba: the same results, slower
    _OUTER: dict[str, Any] = {}
    _INNER: dict[str, Any] = {}
else:
    _OUTER, _INNER = {"pipeline_class": OuterCompiler}, {"pipeline_class": InnerCompiler}

_F = TypeVar("_F", bound=Callable[..., Any])

# without the wrapper for C callers, which nothing here is: a tenth of the time to compile
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

_SINCE_ICE_LAKE = "+avx512vbmi2"  # and Zen 4; these do not slow down

_numba: Any = numba.config
if _numba.CPU_FEATURES is None:  # NUMBA_CPU_FEATURES is the user's
    _features = codegen.get_host_cpu_features()
    if _SINCE_ICE_LAKE in _features.split(","):
        _numba.CPU_FEATURES = f"{_features},-prefer-256-bit"

_COMPILED_BY = tuple(
    stamp(str(Path(__file__).with_name(f"{name}.py")))
    for name in ("compile", "inner_compiler", "borrowed_arrays", "call_types")
)

KERNELS: list[Any] = []  # those of all modules that were imported


def kernel(function: _F) -> _F:
    """Compile `function` in nopython mode at its first call and keep the result on disk."""
    return _compiled(function, {})


def inlined(function: _F) -> _F:
    """`kernel`, but LLVM puts it into those that call it.

    For small matrices, whose sizes are constants there, and where a call costs more than what it does: every
    field of every array of a NamedTuple is an argument of its own.
    """
    return _compiled(function, {"forceinline": True})


def _compiled(function: _F, options: dict[str, Any]) -> _F:
    njit: Any = numba.njit
    compiled: Any = njit(**_OPTIONS, **_OUTER)(function)
    try:
        compiled._cache = _Cache(function)  # what njit(cache=True) does with numba's own
    except RuntimeError:  # numba found no folder that it can write
        warnings.warn(
            "no folder for compiled kernels can be written, every process compiles them anew (about a "
            "minute): set NUMBA_CACHE_DIR to one that can",
            RuntimeWarning,
            stacklevel=3,
        )
    inner = functools.cache(lambda: njit(**_OPTIONS, **_INNER, **options, no_cpython_wrapper=True)(function))
    compiled.get_call_template = lambda args, kws: inner().get_call_template(args, kws)
    compiled.get_overload = lambda sig: inner().get_overload(sig)
    KERNELS.append(compiled)
    return compiled


def kept() -> int:
    """How many of the kernels of the modules imported so far are in the cache, by this process or others."""
    return sum(is_kept(one) for one in KERNELS)


def is_kept(compiled: Any) -> bool:
    """Whether the kernel is in the cache as it is now."""
    return isinstance(compiled._cache, _Cache) and compiled._cache.begun()


class _Cache(FunctionCache):
    """numba's cache; a file that is cut short or garbled, or a full disk, is no exception."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        # both now: the file may be edited before anything is compiled
        self._stamp = self._impl.locator.get_source_stamp()
        stamp(function.__code__.co_filename)
        del self._cache_file  # it would be made before all that the function calls is defined

    @functools.cached_property
    def _cache_file(self) -> Any:  # type: ignore[override]
        return IndexDataCacheFile(
            self._cache_path,
            self._impl.filename_base,
            (self._stamp, parts(self._py_func), _COMPILED_BY),
        )

    def begun(self) -> bool:
        """Whether it holds anything that is still good."""
        try:
            return bool(self._cache_file._load_index())
        except Exception:  # of unpickling anything
            return False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # of unpickling anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()
        except Exception:  # the index is garbled
            with contextlib.suppress(OSError):
                self.flush()
                super().save_overload(sig, data)
