"""Conversion of columns on their way into a table."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet
import pytest

from plugin.record import GROUP_ROWS, Recorder
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


@pytest.mark.parametrize("aside", [False, True])
def test_what_work_appends_comes_after_what_was_appended_before_it(tmp_path: Path, aside: bool) -> None:
    recorder = Recorder("run", tmp_path, tables={"some": (Column("value_m", ""),)}, aside=aside)

    def work() -> None:
        for value in (1.0, 2.0):
            recorder.append("some", {"value_m": np.array([value])})

    recorder.append("some", {"value_m": np.array([0.0])})
    recorder.later(work)
    recorder.append("some", {"value_m": np.array([3.0])})
    recorder.close()
    assert (tmp_path / "some.csv").read_text() == "value_m\n0\n1\n2\n3\n"


def test_a_finished_parquet_file_has_few_groups(tmp_path: Path) -> None:
    recorder = Recorder("run", tmp_path, ("parquet",), {"some": (Column("value_m", ""),)})
    for k in range(25):
        recorder.append("some", {"value_m": np.full(GROUP_ROWS // 10, float(k))})
    recorder.close()
    file = pyarrow.parquet.ParquetFile(tmp_path / "some.parquet")
    groups = [file.metadata.row_group(k).num_rows for k in range(file.metadata.num_row_groups)]
    assert groups == [GROUP_ROWS, GROUP_ROWS, GROUP_ROWS // 2]
    assert file.read()["value_m"].to_numpy().tolist() == np.repeat(np.arange(25.0), GROUP_ROWS // 10).tolist()


def test_numbers_of_tracks_are_whole_also_beside_empty_cells(tmp_path: Path) -> None:
    with_gap = pa.array([3, None], type=pa.int64())
    for directory in (None, tmp_path):
        recorder = Recorder("a", directory)
        recorder.append("steps", {"vehicle_id": ["x", "y"], "fcw_track_id": with_gap})
        recorder.close()
        numbers = recorder.table("steps")["fcw_track_id"]
        assert str(numbers.dtype) == "Int64"
        assert numbers[0] == 3
        assert pd.isna(numbers[1])
