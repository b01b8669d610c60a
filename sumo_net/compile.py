"""The one way in which this project compiles: cached numba kernels that release the GIL.

Kernels take arrays over the fleet, as plain arrays or as NamedTuples of arrays, and loop over the vehicles
inside. Threads, where they help, each get a slice of the fleet.

The cache is beside the code or, where that is not writable, in the user's cache folder. It never causes a
failure: broken entries are compiled anew. So are kernels that call a changed kernel, and all of them after a
change of the compiler modules.

A kernel that is called by another one is compiled into the caller; for that it needs no entry point from
Python and no cache entry of its own (`inner_compiler`).

Vectors have the processor's full width. By default, LLVM uses only half of AVX-512's, because the first
processors that had it lowered their clock rate under it.
"""

import contextlib
import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import codegen
from numba.core.caching import FunctionCache, IndexDataCacheFile

from sumo_net.kernel_sources import parts, stamp

try:
    from sumo_net.checked_arguments import direct
    from sumo_net.inner_compiler import InnerCompiler, OuterCompiler
except ImportError:  # another version of numba: the same results, but slower
    _OUTER: dict[str, Any] = {}
    _INNER: dict[str, Any] = {}

    def direct(dispatcher: Any) -> Callable[..., Any] | None:
        """None: versions do not check their arguments."""
else:
    _OUTER, _INNER = {"pipeline_class": OuterCompiler}, {"pipeline_class": InnerCompiler}

_F = TypeVar("_F", bound=Callable[..., Any])

# without the wrapper for C callers, of which there are none: it takes a tenth of the compilation time
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}

_SINCE_ICE_LAKE = "+avx512vbmi2"  # Ice Lake, Zen 4 and later, which keep their clock rate

_numba: Any = numba.config
if _numba.CPU_FEATURES is None:  # else the user has set NUMBA_CPU_FEATURES
    _features = codegen.get_host_cpu_features()
    if _SINCE_ICE_LAKE in _features.split(","):
        _numba.CPU_FEATURES = f"{_features},-prefer-256-bit"

_COMPILED_BY = tuple(
    stamp(str(Path(__file__).with_name(f"{name}.py")))
    for name in ("compile", "inner_compiler", "borrowed_arrays", "call_types", "checked_arguments")
)

KERNELS: list[Any] = []  # of all modules imported so far


def kernel(function: _F) -> _F:
    """Compile `function` in nopython mode at its first call and keep the result on disk."""
    return _compiled(function, {})


def inlined(function: _F) -> _F:
    """As `kernel`, but inlined into its callers.

    For small matrices, whose sizes are constants in the caller, and where a call costs more than its work:
    every field of every array of a NamedTuple is a separate argument.
    """
    return _compiled(function, {"forceinline": True})


def _compiled(function: _F, options: dict[str, Any]) -> _F:
    njit: Any = numba.njit
    compiled: Any = njit(**_OPTIONS, **_OUTER)(function)
    try:
        compiled._cache = _Cache(function)  # what njit(cache=True) does with numba's own
    except RuntimeError:  # numba found no folder that it can write
        warnings.warn(
            "no folder for compiled kernels is writable, so every process compiles them anew (about a "
            "minute): set NUMBA_CACHE_DIR to a writable folder",
            RuntimeWarning,
            stacklevel=3,
        )
    inner = functools.cache(lambda: njit(**_OPTIONS, **_INNER, **options, no_cpython_wrapper=True)(function))
    compiled.get_call_template = lambda args, kws: inner().get_call_template(args, kws)
    compiled.get_overload = lambda sig: inner().get_overload(sig)
    KERNELS.append(Kernel(compiled))
    return cast(_F, KERNELS[-1])


class Kernel:
    """A compiled function. A call goes directly to its first version, if that fits the arguments."""

    def __init__(self, dispatcher: Any) -> None:
        """`dispatcher`: numba's object, which finds or compiles the version for given arguments."""
        functools.update_wrapper(self, dispatcher.py_func)
        self._dispatcher = dispatcher
        self._numba_type_ = numba.types.Dispatcher(dispatcher)  # what numba takes it for in other kernels
        self._call: Callable[..., Any] = self._first

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        try:
            return self._call(*arguments)
        except TypeError:  # another version, or an error of the caller
            return self._dispatcher(*arguments)

    def __reduce__(self) -> str:
        """Copied and pickled as functions are: by its name."""
        return str(self.__qualname__)

    def __getattr__(self, name: str) -> Any:
        """Everything else is numba's."""
        return getattr(self._dispatcher, name)

    def _first(self, *arguments: Any) -> Any:
        result = self._dispatcher(*arguments)
        self._call = direct(self._dispatcher) or self._dispatcher
        return result


def kept() -> int:
    """Number of kernels of the modules imported so far that are in the cache, from this process or others."""
    return sum(is_kept(one) for one in KERNELS)


def is_kept(compiled: Any) -> bool:
    """Whether the present version of a kernel is in the cache."""
    return isinstance(compiled._cache, _Cache) and compiled._cache.begun()


class _Cache(FunctionCache):
    """numba's cache; truncated or corrupt files and a full disk raise no exception."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        # both at import: the file may be edited before anything is compiled
        self._stamp = self._impl.locator.get_source_stamp()
        stamp(function.__code__.co_filename)
        del self._cache_file  # made later, when everything that the function calls is defined

    @functools.cached_property
    def _cache_file(self) -> Any:  # type: ignore[override]
        return IndexDataCacheFile(
            self._cache_path,
            self._impl.filename_base,
            (self._stamp, parts(self._py_func), _COMPILED_BY),
        )

    def begun(self) -> bool:
        """Whether there is an entry that is still valid."""
        try:
            return bool(self._cache_file._load_index())
        except Exception:  # unpickling may raise anything
            return False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling may raise anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()
        except Exception:  # the index is corrupt
            with contextlib.suppress(OSError):
                self.flush()
                super().save_overload(sig, data)
