"""numba infers the type of a call once; other uses of numba are not affected."""

from typing import Any

import numba
import pytest
from numba.core import types
from numba.core.errors import TypingError

from sumo_net import call_types
from sumo_net.call_types import RememberingCompiler


def compiled(function: Any, **options: Any) -> Any:
    return numba.njit(numba.float64(numba.float64), pipeline_class=RememberingCompiler, **options)(function)


def first(x: float) -> float:
    return x + x * x


def second(x: float) -> float:
    return max(x * x, x) + x


def fails(x: float) -> float:
    return x + "no number"  # type: ignore[operator,no-any-return]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, Any]]:
    """Calls that numba was asked of, as function and types."""
    calls: list[tuple[Any, Any]] = []
    ask = call_types._ask

    def listening(function: Any, context: Any, args: Any, kws: Any) -> Any:
        calls.append((function, args))
        return ask(function, context, args, kws)

    monkeypatch.setattr(call_types, "_ask", listening)
    monkeypatch.setattr(call_types, "_signatures", {})
    return calls


def test_asked_once(asked: list[tuple[Any, Any]]) -> None:
    assert compiled(first)(3.0) == 12.0
    assert asked
    assert len(asked) == len(set(asked))
    asked_of_first = set(asked)
    asked.clear()
    assert compiled(second)(3.0) == 12.0
    assert asked
    assert not asked_of_first & set(asked)


def test_asked_again_where_what_is_called_would_be_compiled_otherwise(asked: list[tuple[Any, Any]]) -> None:
    compiled(first)
    asked_of_first = set(asked)
    asked.clear()
    compiled(first, forceinline=True)
    assert set(asked) == asked_of_first


def test_numba_is_as_it_was_afterwards() -> None:
    before = types.Function.get_call_type
    compiled(first)
    assert types.Function.get_call_type is before
    with pytest.raises(TypingError):
        compiled(fails)
    assert types.Function.get_call_type is before
