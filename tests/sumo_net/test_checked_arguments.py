"""A kernel that is called directly takes only arguments of its own types, as numba's `typeof` tells them."""

import copy
import pickle
import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from sumo_net import checked_arguments
from sumo_net.checked_arguments import checkable, direct
from sumo_net.compile import kernel


class Given(NamedTuple):
    """A number and an array."""

    number: float
    array: np.ndarray


class Other(NamedTuple):
    """The same, called otherwise."""

    number: float
    array: np.ndarray


class Whole(NamedTuple):
    """Of all kinds."""

    given: Given
    pair: tuple[Any, ...]
    count: int
    on: bool
    nothing: None


class Sub(np.ndarray):
    """Not exactly an array."""


def _constant(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def _misaligned() -> np.ndarray:
    return np.zeros(17, np.uint8)[1:].view(np.float64)


FLOATS = np.arange(12.0)
TABLE = FLOATS.reshape(3, 4)
GIVEN = Given(1.5, FLOATS)
WHOLE = Whole(GIVEN, (True, FLOATS), 3, False, None)
VALUES: list[Any] = [
    *(1.5, float("nan"), 3, -(2**63), 2**63 - 1, 2**63, True, False, None),
    *((1.5, 3), (1.5,), (1.5, 3, 3), ((1.5, 3),)),
    *(np.float64(1.5), np.float32(1.5), np.int64(3), np.int32(3), np.bool_(True)),
    *(FLOATS.astype(kind) for kind in (">f8", "f8", "f4", "i8", "u8", "i1", "c8", "c16", "?", "M8[s]", "O")),
    *(FLOATS[:0], FLOATS[::2], np.array(1.0), _constant(FLOATS.copy()), _misaligned(), FLOATS.view(Sub)),
    *(TABLE, TABLE.T, TABLE[:, ::2], TABLE[:1, :1], TABLE[None], _constant(TABLE.T.copy())),
    *(GIVEN, Other(*GIVEN), GIVEN._replace(number=2), Given(1.5, FLOATS[::2]), Given(1.5, TABLE)),
    *(
        WHOLE,
        WHOLE._replace(pair=(True, 1.5)),
        WHOLE._replace(given=Other(*GIVEN)),
        WHOLE._replace(count=3.0),
    ),
]
NEITHER: list[Any] = [[1.5, 3], FLOATS.tolist(), "text", {}, object()]  # lists, and what numba does not know


def _nothing(_value):  # type: ignore[no-untyped-def]
    return 7


def _type(value: Any) -> Any:
    try:
        return numba.typeof(value)
    except (TypeError, ValueError, numba.core.errors.NumbaError):
        return None


@pytest.fixture(scope="module")
def versions() -> dict[Any, Callable[[Any], Any]]:
    """A direct call by type of the argument."""
    by_type = {}
    for value in VALUES:
        kind = _type(value)
        if kind is not None and checkable(kind) and kind not in by_type:
            fresh: Any = kernel(_nothing)
            assert fresh(value) == 7
            by_type[kind] = direct(fresh)
    return by_type


def test_exactly_the_types_are_taken(versions: dict[Any, Callable[[Any], Any]]) -> None:
    taken = 0
    for kind, call in versions.items():
        for value in VALUES + NEITHER:
            if _type(value) == kind:
                assert call(value) == 7
                taken += 1
            else:
                with pytest.raises(TypeError, match="another type"):
                    call(value)
    assert len(versions) >= 20
    assert taken > len(versions)


def test_a_number_of_arguments_that_is_wrong_is_numbas_error() -> None:
    fresh: Any = kernel(_nothing)
    assert fresh(1.5) == 7
    for wrong in ((), (1.5, 1.5)):
        with pytest.raises(TypeError, match="argument"):
            fresh(*wrong)


def _doubled(x):  # type: ignore[no-untyped-def]
    return 2 * x


def test_other_types_are_compiled_and_remembered_by_numba() -> None:
    fresh: Any = kernel(_doubled)
    for _ in range(2):
        assert fresh(1.5) == 3.0
        assert fresh(3) == 6
        assert isinstance(fresh(3), int)
        np.testing.assert_array_equal(fresh(FLOATS), 2 * FLOATS)
    assert len(fresh.signatures) == 3
    with pytest.raises(numba.TypingError):
        fresh(None)


@kernel
def _turned(whole, scale):  # type: ignore[no-untyped-def]
    array = scale * whole.given.array
    if whole.on:
        array = array + whole.count
    number = whole.given.number + whole.pair[1][0]
    return Whole(Given(number, array), (whole.on, whole.pair[1]), whole.count + 1, not whole.on, None)


@kernel
def _sum_of(whole):  # type: ignore[no-untyped-def]
    total = whole.given.number + whole.count
    for part in whole.given.array:
        total += part
    return total


@pytest.mark.parametrize("count", [0, -5, 2**40])
@pytest.mark.parametrize("on", [True, False])
def test_values_arrive_and_come_back(on: bool, count: int) -> None:
    for factor in (1.0, 2.0):  # the second time directly
        whole = Whole(Given(factor / 3.0, factor * FLOATS), (on, FLOATS + 5.0), count, on, None)
        turned: Any = _turned(whole, 10.0)
        assert (type(turned), type(turned.given)) == (Whole, Given)
        np.testing.assert_array_equal(turned.given.array, 10.0 * factor * FLOATS + (count if on else 0))
        assert turned.given.number == factor / 3.0 + 5.0
        assert turned.pair[0] is on
        np.testing.assert_array_equal(turned.pair[1], FLOATS + 5.0)
        assert turned[2:] == (count + 1, not on, None)
        assert _sum_of(whole) == pytest.approx(factor / 3.0 + count + factor * FLOATS.sum())


def _objects() -> Iterator[int]:
    _nrt_python.memsys_enable_stats()
    while True:
        stats = rtsys.get_allocation_stats()
        counts = map(sys.getrefcount, (FLOATS, Given, Whole, None, True, 1.5, float, tuple))
        yield stats.alloc - stats.free, stats.mi_alloc - stats.mi_free, *counts  # type: ignore[misc]


def test_nothing_is_kept_of_calls_or_refusals() -> None:
    whole = Whole(Given(1.5, FLOATS), (True, FLOATS), 1000, True, None)
    wrong = whole._replace(pair=(True, FLOATS.astype(np.float32)))
    _turned(whole, 1.0)
    call = direct(_turned)
    assert call is not None
    objects, array = _objects(), sys.getrefcount(np.ndarray)
    before = next(objects)
    for _ in range(1000):
        turned = call(whole, 1.0)
        with pytest.raises(TypeError):
            call(wrong, 1.0)
        with pytest.raises(TypeError):
            call(whole, 1)
    del turned
    assert np.abs(np.subtract(next(objects), before)).max() < 100
    assert sys.getrefcount(np.ndarray) >= array


def test_a_kernel_is_copied_and_pickled_by_its_name() -> None:
    assert copy.deepcopy(_turned) is _turned
    assert pickle.loads(pickle.dumps(_turned)) is _turned


def test_objects_of_another_layout_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert checked_arguments._as_expected()
    for name in [one for one in vars(checked_arguments) if one.startswith(("_ARRAY_", "_DTYPE_", "_TUPLE_"))]:
        with monkeypatch.context() as changed:
            changed.setattr(checked_arguments, name, getattr(checked_arguments, name) + 4)
            assert not checked_arguments._as_expected(), name
