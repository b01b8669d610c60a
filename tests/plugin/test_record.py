"""What becomes of a column on its way into a table."""

import numpy as np
import pyarrow as pa
import pytest

from plugin.record import Recorder
from plugin.schema import Column
from plugin.truth import named


@pytest.mark.parametrize("decimals", [0, 2, 6])
def test_numbers_are_rounded_as_numpy_does_and_empty_where_there_are_none(decimals: int) -> None:
    rng = np.random.default_rng(decimals)
    values = rng.standard_normal(1001) * 10.0 ** rng.integers(-9, 9, 1001)
    values[::7], values[3], values[4], values[5] = np.nan, np.inf, -np.inf, -1e-12
    recorder = Recorder("run", tables={"some": (Column("value_m", "", decimals=decimals),)})
    recorder.append("some", {"value_m": values})
    found = recorder.table("some")["value_m"].to_numpy()
    expected = np.round(values, decimals)
    np.testing.assert_array_equal(found, np.where(np.isfinite(expected), expected, np.nan))
    assert not np.signbit(found[found == 0.0]).any()


def test_names_of_handles_come_in_their_order() -> None:
    names = {7: "seven", -3: "minus three", 1_000: None}
    handles = np.array([1_000, 7, 7, -3, 1_000, 7])
    assert named(handles, names.__getitem__).to_pylist() == [names[int(one)] for one in handles]
    assert named(handles[:0], names.__getitem__).equals(pa.array([], pa.string()))
