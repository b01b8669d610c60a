"""Kernels without reference counting give the same results, and free nothing too early or never."""

from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from sumo_net.borrowed_arrays import BorrowingCompiler
from sumo_net.compile import inlined, kernel
from sumo_net.scratch import scratch


class Pair(NamedTuple):
    """Two arrays."""

    left: np.ndarray
    right: np.ndarray


@kernel
def _views(pair, out):  # type: ignore[no-untyped-def]
    swapped = Pair(pair.right, pair.left)
    work = scratch(2)
    for i in range(len(out)):
        row = swapped.left[i, 1:3]
        work[0], work[1] = row[0], swapped.right[i, 0]
        for part in range(2):
            out[i] += work[part]


@inlined
def _given_back(a):  # type: ignore[no-untyped-def]
    return a[1:]


@kernel
def _made(a):  # type: ignore[no-untyped-def]
    copy = a.copy()
    return copy[::2] + 1.0


@kernel
def _uses_what_others_make(a):  # type: ignore[no-untyped-def]
    total = 0.0
    for _ in range(3):
        total += _made(a)[0] + _given_back(a)[0] + a[np.array([1])][0]
    return total


@kernel
def _all_of_it(pair, out):  # type: ignore[no-untyped-def]
    _views(pair, out)
    return _uses_what_others_make(out), _given_back(_given_back(out)), _made(out)


def test_results_and_memory() -> None:
    pair = Pair(*np.random.default_rng(1).standard_normal((2, 4, 3)))
    expected = pair.right[:, 1] + pair.left[:, 0]
    _all_of_it(pair, np.zeros(4))
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    for _ in range(50):
        total, view, made = _all_of_it(pair, np.zeros(4))
        np.testing.assert_allclose(view, expected[2:])
        np.testing.assert_allclose(made, expected[::2] + 1.0)
        assert total == pytest.approx(3.0 * (expected[0] + 1.0 + 2.0 * expected[1]))
    del view, made
    after = rtsys.get_allocation_stats()
    assert after.alloc > before.alloc
    assert after.alloc - before.alloc == after.free - before.free
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free


def _counts(function: Any, *kinds: Any) -> bool:
    inner: Any = numba.njit(pipeline_class=BorrowingCompiler, no_cpython_wrapper=True)(function)
    inner.compile(kinds)
    (code,) = inner.inspect_llvm().values()
    return "NRT_" in code


def test_who_counts() -> None:
    array: Any = numba.float64[:, ::1]
    pair = numba.types.NamedUniTuple(array, 2, Pair)
    assert not _counts(_views.py_func, pair, numba.float64[::1])
    assert _counts(_made.py_func, numba.float64[::1])
    assert _counts(_given_back.py_func, numba.float64[::1])
    assert _counts(_uses_what_others_make.py_func, numba.float64[::1])
