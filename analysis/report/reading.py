"""Tolerant reading of tables that are complete, cut off, of an older schema, or missing, with notes."""

import io
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from plugin.record import arrow_schema, read_table, to_pandas
from plugin.schema import TABLES

Kind = Literal["run", "campaign", "recording"]


class ReportError(ValueError):
    """Nothing can be shown; the message is for users."""


@dataclass(frozen=True, slots=True, eq=False)
class RunTables:
    """The tables of a run, each with all columns of `plugin.schema`, and notes on missing parts."""

    directory: Path
    tables: dict[str, pd.DataFrame]
    notes: list[str] = field(default_factory=list)
    settings: dict[str, Any] = field(default_factory=dict)  # of configuration.json; {} if there is none

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self.tables[name]


def kind_of(directory: Path) -> Kind:
    """Kind of the directory's contents. Raises ReportError if nothing in it can be shown."""
    if not directory.is_dir():
        raise ReportError(f"{directory}: no such directory")
    if (directory / "plan.json").is_file() or (directory / "campaign.json").is_file():
        return "campaign"
    for table in ("steps", "runs", "predictions", "warnings"):
        ends = ("csv", "parquet", "parquet.parts", "parquet.part")  # the last of an older version
        if any((directory / f"{table}.{end}").exists() for end in ends):
            return "run"
    if (directory / "lanes.csv").is_file() or (directory / "tracks.csv").is_file():
        return "recording"
    if (directory / "rates.csv").is_file():
        return "campaign"
    raise ReportError(
        f"{directory}: holds no table: neither a run's (steps.csv or .parquet), nor a campaign's "
        "(plan.json), nor a recorded drive's (lanes.csv, tracks.csv)"
    )


def read_run(directory: Path) -> RunTables:
    """All tables of a run's directory; missing tables are empty, missing columns unknown."""
    notes: list[str] = []
    tables = {name: read_lenient(directory, name, notes) for name in TABLES}
    settings: dict[str, Any] = {}
    path = directory / "configuration.json"
    if path.is_file():
        try:
            read = json.loads(path.read_text(encoding="utf-8"))
            settings = read.get("settings", {}) if isinstance(read, dict) else {}
        except (OSError, ValueError):
            notes.append("configuration.json cannot be read: the settings are not shown")
    if tables["runs"].empty and not tables["steps"].empty:
        notes.append("The run was interrupted: the table runs is empty, the rows so far are shown")
    if tables["steps"].empty:
        notes.append("No equipped vehicle drove, or its rows were lost: the table steps is empty")
    return RunTables(directory, tables, notes, settings)


def read_lenient(directory: Path, name: str, notes: list[str]) -> pd.DataFrame:
    """One table with all columns of its schema; missing or cut-off parts are added to `notes`."""
    schema = arrow_schema(TABLES[name])
    table = _from_file(directory, name, schema, notes)
    if table is None:
        return to_pandas(schema.empty_table())
    missing = [column for column in schema.names if column not in table.column_names]
    if missing:
        listed = ", ".join(missing[:6]) + (f" and {len(missing) - 6} more" if len(missing) > 6 else "")
        notes.append(f"Table {name} is of another version: it has no column {listed}")
    arrays = []
    for column in schema:
        if column.name in missing:
            arrays.append(pa.nulls(table.num_rows, column.type))
            continue
        try:
            arrays.append(table[column.name].cast(column.type))
        except pa.ArrowInvalid:
            notes.append(f"Table {name}: column {column.name} is not of type {column.type} and is left out")
            arrays.append(pa.nulls(table.num_rows, column.type))
    return to_pandas(pa.Table.from_arrays(arrays, schema=schema))


def _from_file(directory: Path, name: str, schema: pa.Schema, notes: list[str]) -> pa.Table | None:
    parquet, csv = directory / f"{name}.parquet", directory / f"{name}.csv"
    if parquet.is_file():
        try:
            return pa.parquet.read_table(parquet)
        except (pa.ArrowException, OSError):
            notes.append(f"{parquet.name} cannot be read: cut off, or no Parquet file")
    if csv.is_file():
        return _from_csv(csv, name, schema, notes)
    if not parquet.is_file():
        try:  # also the parts of an interrupted run
            return pa.Table.from_pandas(read_table(directory, name), preserve_index=False)
        except FileNotFoundError:
            pass
        except (pa.ArrowException, OSError, ValueError):
            notes.append(f"Table {name} cannot be read")
        if parquet.with_name(parquet.name + ".part").exists():
            notes.append(
                f"Table {name} was being written when the run was interrupted ({parquet.name}.part): "
                "Parquet without its end cannot be read; --format csv or both keeps the rows so far"
            )
        else:
            notes.append(f"There is no table {name} ({csv.name} or {parquet.name})")
    return None


def _from_csv(path: Path, name: str, schema: pa.Schema, notes: list[str]) -> pa.Table | None:
    content = path.read_bytes()
    if not content.endswith(b"\n"):
        content = content[: content.rfind(b"\n") + 1]
        notes.append(f"{path.name} ends within a row: the run was interrupted, the row is left out")
    if not content.strip():
        return None
    try:
        content.decode()
    except UnicodeDecodeError:  # Arrow would fail on it half-way
        notes.append(f"{path.name} cannot be read: it is not text")
        return None
    skipped = 0

    def skip(row: Any) -> str:
        nonlocal skipped
        skipped += 1
        return "skip"

    # columns as text first: a value that is not a number then affects its column, not the table
    text = {column.name: pa.string() for column in schema}
    convert = pa.csv.ConvertOptions(column_types=text, strings_can_be_null=True)
    parse = pa.csv.ParseOptions(newlines_in_values=True, invalid_row_handler=skip)
    for types in (dict(zip(schema.names, schema.types, strict=True)), text):
        skipped = 0
        convert.column_types = types
        try:
            table = pa.csv.read_csv(pa.BufferReader(content), parse_options=parse, convert_options=convert)
        except pa.ArrowInvalid:
            continue
        if skipped:
            notes.append(f"{path.name}: {skipped} rows with too few or too many fields are left out")
        return table
    notes.append(f"{path.name} cannot be read: it is not a CSV table")
    return None


def read_csv(directory: Path, name: str, notes: list[str]) -> pd.DataFrame:
    """A CSV file of a campaign or a recorded drive; an empty table if it is missing or unreadable."""
    path = directory / name
    if not path.is_file():
        return pd.DataFrame()
    content = path.read_bytes()
    if not content.endswith(b"\n"):
        content = content[: content.rfind(b"\n") + 1]
        notes.append(f"{name} ends within a row: writing was interrupted, the row is left out")
    try:
        return pd.read_csv(io.BytesIO(content), on_bad_lines="skip")
    except (ValueError, UnicodeDecodeError) as error:
        if content.strip():
            notes.append(f"{name} cannot be read ({type(error).__name__})")
        return pd.DataFrame()


def json_ready(value: Any) -> Any:
    """The value with None for what JSON cannot represent: NaN, infinities, pandas' missing values."""
    if isinstance(value, dict):
        return {str(key): json_ready(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(one) for one in value]
    if isinstance(value, np.ndarray | pd.Series):
        return [json_ready(one) for one in value.tolist()]
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or value is pd.NA or (isinstance(value, float) and not np.isfinite(value)):
        return None
    return value
