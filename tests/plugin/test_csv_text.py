"""The text of tables against Arrow's own writer."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plugin.csv_text import csv_rows
from plugin.record import to_table
from plugin.schema import Column

COLUMNS = (
    Column("run_id", "", "text"),
    *(Column(f"number_{decimals}", "", decimals=decimals) for decimals in range(10)),
    Column("count", "", "int"),
    Column("shown", "", "bool"),
    Column("vehicle_id", "", "text"),
    Column("nothing", ""),
)


def by_arrow(table: pa.Table, quoting_style: str = "none") -> bytes:
    rows = io.BytesIO()
    pa.csv.write_csv(table, rows, pa.csv.WriteOptions(include_header=False, quoting_style=quoting_style))
    return rows.getvalue()


def written(table: pa.Table) -> bytes:
    return b"".join(bytes(some) for some in csv_rows(table, COLUMNS))


def rows(count: int, seed: int = 0, powers: tuple[int, int] = (-11, 9)) -> pa.Table:
    rng = np.random.default_rng(seed)
    values = {}
    for column in COLUMNS[1:-1]:
        if column.kind == "float":
            values[column.name] = rng.standard_normal(count) * 10.0 ** rng.integers(*powers, count)
            values[column.name][rng.random(count) < 0.2] = np.nan
    whole, missing = rng.integers(-(10**12), 10**12, count), rng.random((2, count)) < 0.2
    values["count"] = np.ma.array(whole >> rng.integers(0, 40, count), mask=missing[0])
    values["shown"] = np.ma.array(rng.random(count) < 0.5, mask=missing[1])
    texts = np.array(["", "highway.3", "é", "a;b 'c'"], object)[rng.integers(0, 4, count)]
    values["vehicle_id"] = pa.array(
        [None if i % 7 == 3 else text for i, text in enumerate(texts)], pa.string()
    )
    return to_table("run", COLUMNS, values)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("powers", [(-11, 9), (9, 17)])
def test_rows_are_those_of_arrow(seed: int, powers: tuple[int, int]) -> None:
    table = rows(5000, seed, powers)
    assert written(table) == by_arrow(table)
    assert written(table.slice(4093, 101)) == by_arrow(table.slice(4093, 101))
    assert written(table.slice(7, 0)) == b""


@settings(max_examples=300)
@given(st.integers(-(10**15) + 1, 10**15 - 1), st.integers(0, 9))
def test_every_number_is_that_of_arrow(parts: int, decimals: int) -> None:
    table = to_table("run", COLUMNS, {f"number_{decimals}": np.array([parts, 1, 10, parts]) / 10.0**decimals})
    assert written(table) == by_arrow(table)


def test_the_ends_of_what_is_written_as_a_decimal() -> None:
    ends = np.array([0.0, 1e-6, 9e-7, 1e-9, 1.2e-7, 9999999999.0, 1e10, 1.5e10, 1e15, 1e16, 1e300])
    for column in COLUMNS[1:11]:
        for one in (*ends, *(-ends)):
            table = to_table("run", COLUMNS, {column.name: np.array([one])})
            assert written(table) == by_arrow(table)


@pytest.mark.parametrize("text", ["a,b", 'say "a"', "two\nlines", "\r"])
def test_texts_that_need_quotation_marks_have_them(text: str) -> None:
    table = to_table("run", COLUMNS, {"vehicle_id": pa.array(["plain", text, None])})
    assert written(table) == by_arrow(table, "needed")
