"""Tables on disk or in memory: chunks of columns in, CSV and Parquet files or pandas tables out."""

import contextlib
import io
import os
import shutil
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from pydantic import Field

from plugin import record_kernels as kernels
from plugin.schema import TABLES, Column
from sumo_net.settings import settings


@settings
class Recording:
    """What is recorded besides events: rows of the largest table, camera frames."""

    tracks: bool = Field(True, description="write the table `tracks`")
    roadside_every: int = Field(
        10,
        ge=1,
        description="tracks of roadside objects and clutter are written only in one of this many scans, "
        "and where they are the warning's target",
    )
    frames: int = Field(
        0,
        ge=0,
        le=1000,
        description="number of vehicles, the first on the road, whose camera frames are kept",
    )


FORMATS = ("csv", "parquet")
GROUP_ROWS = 100_000  # of Parquet, in a finished file
MOST_WAITING = 8  # jobs of the writing thread; more would let memory grow, so the caller waits
_ARROW = {"float": pa.float64(), "int": pa.int64(), "bool": pa.bool_(), "text": pa.string()}


class Recorder:
    """Writes chunks of every table as they come, so that memory stays flat.

    Parameters
    ----------
    run_id : written to every row.
    directory : where the files go; None keeps the tables in memory.
    formats : one of "csv", "parquet", or both. Raises ValueError for any other, or none.
    tables : the schema, by default that of `plugin.schema`.
    aside : write in a separate thread, most of the time without the GIL. `flush` waits for it.
    """

    def __init__(
        self,
        run_id: str,
        directory: Path | str | None = None,
        formats: Iterable[str] | str = ("csv",),
        tables: Mapping[str, tuple[Column, ...]] = TABLES,
        aside: bool = False,
    ) -> None:
        self.run_id = run_id
        formats = _known(formats)
        directory = None if directory is None else Path(directory)
        self.directory = directory
        self._schema = tables
        self._memory: dict[str, list[pa.Table]] = {name: [] for name in tables}
        self._writers: dict[str, list[_CsvFile | _ParquetFile]] = {name: [] for name in tables}
        self._aside = 0  # identifier of the writing thread
        self._thread = ThreadPoolExecutor(1, "tables", self._begin) if aside else None
        self._waiting: deque[Future[None]] = deque()
        if directory is not None:
            directory.mkdir(parents=True, exist_ok=True)
            for name, columns in tables.items():
                schema = arrow_schema(columns)
                for suffix in FORMATS:  # files of an earlier run
                    (directory / f"{name}.{suffix}").unlink(missing_ok=True)
                shutil.rmtree(_parts(directory / f"{name}.parquet"), ignore_errors=True)
                if "csv" in formats:
                    self._writers[name].append(_CsvFile(directory / f"{name}.csv", schema))
                if "parquet" in formats:
                    self._writers[name].append(_ParquetFile(directory / f"{name}.parquet", schema))

    @property
    def names(self) -> tuple[str, ...]:
        """The tables' names."""
        return tuple(self._schema)

    def append(self, name: str, columns: Mapping[str, Any]) -> None:
        """Add rows to table `name`; `columns` maps column names to equally long arrays.

        A column that is missing is left empty. NaN in a float column is written as empty. The arrays must not
        change afterwards. Raises OSError as `flush` does; with `aside`, also for rows appended earlier.
        """
        unknown = set(columns) - {column.name for column in self._schema[name]}
        if unknown:
            raise KeyError(f"table '{name}' has no column {sorted(unknown)}")
        self.later(partial(self._write, name, columns))

    def later(self, work: Callable[[], None]) -> None:
        """Do work that appends rows: with `aside`, after what was appended before; otherwise at once.

        Raises OSError as `flush` does.
        """
        if self._thread is None or threading.get_ident() == self._aside:
            work()
        else:
            self._waiting.append(self._thread.submit(work))
            self.flush(MOST_WAITING)

    def _begin(self) -> None:
        self._aside = threading.get_ident()

    def _write(self, name: str, columns: Mapping[str, Any]) -> None:
        table = to_table(self.run_id, self._schema[name], columns)
        if table.num_rows == 0:
            return
        if self.directory is None:
            self._memory[name].append(table)
        with contextlib.ExitStack() as every:  # all are called even if one raises: no file gets a gap
            for writer in self._writers[name]:
                every.callback(writer.write, table)

    def flush(self, waiting: int = 0) -> None:
        """Wait until at most `waiting` jobs are left; raise the first error so far.

        Raises OSError, which names the file and says why.
        """
        while self._waiting and (self._waiting[0].done() or len(self._waiting) > waiting):
            self._waiting.popleft().result()

    def table(self, name: str) -> pd.DataFrame:
        """One table, as far as recorded."""
        schema = arrow_schema(self._schema[name])
        if self.directory is None:
            return to_pandas(pa.concat_tables([schema.empty_table(), *self._memory[name]]))
        self.flush()
        return read_table(self.directory, name)

    def unwritten(self, name: str, columns: Mapping[str, Any]) -> pd.DataFrame:
        """Rows of table `name` as `append` would write them; no row without columns."""
        if not columns:
            return to_pandas(arrow_schema(self._schema[name]).empty_table())
        return to_pandas(to_table(self.run_id, self._schema[name], columns))

    def close(self) -> None:
        """Finish the files; safe to call twice."""
        with contextlib.ExitStack() as every:  # all are called even if one raises
            for writers in self._writers.values():
                for writer in writers:
                    every.callback(writer.close)
            if self._thread is not None:
                every.callback(self._thread.shutdown)
            every.callback(self.flush)  # registered last, so called first


def read_table(directory: Path | str, name: str) -> pd.DataFrame:
    """One table of a finished, interrupted or killed run, without an incomplete last row.

    Raises FileNotFoundError where the directory holds none.
    """
    directory = Path(directory)
    parquet, csv = directory / f"{name}.parquet", directory / f"{name}.csv"
    if parquet.exists():
        return to_pandas(pa.parquet.read_table(parquet))
    parts = sorted(_parts(parquet).glob("*.parquet"))
    if parts:
        return to_pandas(pa.concat_tables([pa.parquet.read_table(part) for part in parts]))
    if csv.exists():
        return to_pandas(_read_csv(csv, arrow_schema(TABLES[name])))
    if _parts(parquet).is_dir():
        return to_pandas(arrow_schema(TABLES[name]).empty_table())
    raise FileNotFoundError(f"{directory}: holds no table '{name}' ({csv.name} or {parquet.name})")


def _read_csv(csv: Path, schema: pa.Schema) -> pa.Table:
    if not csv.stat().st_size:
        return schema.empty_table()
    with pa.memory_map(str(csv)) as file:
        rows = file.read_buffer()
        whole = len(rows)
        while whole and rows[whole - 1] != ord("\n"):  # killed, or the disk was full, within a row
            whole -= 1
        if not whole:
            return schema.empty_table()
        options = pa.csv.ConvertOptions(
            column_types={field.name: field.type for field in schema},
            null_values=[""],  # Arrow's default list contains possible vehicle ids: NaN, null, NA
            strings_can_be_null=True,
        )
        return pa.csv.read_csv(pa.BufferReader(rows.slice(0, whole)), convert_options=options)


def to_pandas(table: pa.Table) -> pd.DataFrame:
    """A DataFrame in which empty cells are pandas' own missing value also for booleans, text and numbers."""
    frame: pd.DataFrame = table.to_pandas(types_mapper={pa.bool_(): pd.BooleanDtype()}.get)
    for field in table.schema:
        if pa.types.is_integer(field.type) and table[field.name].null_count:  # a float column until here
            frame[field.name] = frame[field.name].astype(pd.Int64Dtype())
    return frame


def _known(formats: Iterable[str] | str) -> tuple[str, ...]:
    chosen = (formats,) if isinstance(formats, str) else tuple(formats)
    unknown = [one for one in chosen if one not in FORMATS]
    if unknown or not chosen:
        found = repr(unknown[0]) if unknown else "none"
        raise ValueError(f"formats: {found}: known are {', '.join(FORMATS)}")
    return chosen


class _CsvFile:
    """CSV file; a chunk of rows is written completely or, if that fails, not at all."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._path, self._failed = path, False
        self._file = path.open("wb", buffering=0)
        self._put((",".join(schema.names) + "\n").encode())

    def write(self, table: pa.Table) -> None:
        if self._failed:  # earlier rows are complete; better to stop than to leave a gap
            return
        try:
            rows = _csv_rows(table, "none")
        except pa.ArrowInvalid:  # a comma or quotation mark in a text
            rows = _csv_rows(table, "needed")  # puts every text in quotation marks
        self._put(rows)

    def _put(self, rows: bytes) -> None:
        before, left = self._file.tell(), memoryview(rows)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._failed = True
            with contextlib.suppress(OSError):
                self._file.truncate(before)
            raise _named(error, self._path) from None

    def close(self) -> None:
        if not self._file.closed:
            with self._file:
                os.fsync(self._file.fileno())


class _ParquetFile:
    """Rows go into complete files in `NAME.parquet.parts`, which are merged to `NAME.parquet` at the end.

    A Parquet file is unreadable before its footer is written; a killed run leaves readable parts.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self._path, self._schema, self._folder = path, schema, _parts(path)
        self._count, self._open, self._failed = 0, True, False
        self._folder.mkdir(parents=True)

    def write(self, table: pa.Table) -> None:
        if self._failed:
            return
        self._put(self._folder / f"{self._count:06d}.parquet", [table])
        self._count += 1

    def close(self) -> None:
        if not self._open:
            return
        self._open = False
        parts = sorted(self._folder.glob("*.parquet"))
        if len(parts) == 1:
            parts[0].replace(self._path)
        else:
            self._put(self._path, _grouped(pa.parquet.read_table(part) for part in parts))
        shutil.rmtree(self._folder)

    def _put(self, place: Path, tables: Iterable[pa.Table]) -> None:
        unfinished = self._folder / "unfinished"
        try:
            with pa.parquet.ParquetWriter(unfinished, self._schema, compression="zstd") as writer:
                for table in tables:
                    writer.write_table(table)
            unfinished.replace(place)
        except OSError as error:
            self._failed = True
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise _named(error, place) from None


def _grouped(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """The same rows in tables of GROUP_ROWS or a little more: small groups cost Parquet space and time."""
    waiting: list[pa.Table] = []
    for table in tables:
        waiting.append(table)
        if sum(one.num_rows for one in waiting) >= GROUP_ROWS:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)


def _parts(path: Path) -> Path:
    return path.with_name(path.name + ".parts")


def _named(error: OSError, path: Path) -> OSError:
    reason = os.strerror(error.errno) if error.errno else str(error)
    return OSError(error.errno or 0, f"cannot be written ({reason}); earlier rows are complete", str(path))


def _csv_rows(table: pa.Table, quoting_style: str) -> bytes:
    rows = io.BytesIO()
    pa.csv.write_csv(table, rows, pa.csv.WriteOptions(include_header=False, quoting_style=quoting_style))
    return rows.getvalue()


def to_table(run_id: str, columns: tuple[Column, ...], values: Mapping[str, Any]) -> pa.Table:
    """An Arrow table from equally long arrays by column; missing columns are null."""
    rows = len(next(iter(values.values())))
    arrays = []
    for column in columns:
        if column.name == "run_id":
            arrays.append(pa.repeat(pa.scalar(run_id), rows))
        elif column.name not in values:
            arrays.append(pa.nulls(rows, _ARROW[column.kind]))
        else:
            arrays.append(_to_array(column, values[column.name]))
    return pa.Table.from_arrays(arrays, schema=arrow_schema(columns))


def arrow_schema(columns: tuple[Column, ...]) -> pa.Schema:
    """The Arrow types of a table's columns."""
    return pa.schema([(column.name, _ARROW[column.kind]) for column in columns])


def _to_array(column: Column, values: Any) -> pa.Array:
    if column.kind == "float":
        values = np.ascontiguousarray(values, np.float64)
        numbers, known, missing = kernels.rounded(values, 10.0**column.decimals)
        buffers = [pa.py_buffer(known), pa.py_buffer(numbers)]
        return pa.Array.from_buffers(pa.float64(), len(numbers), buffers, missing)
    if isinstance(values, pa.Array):
        return values
    if isinstance(values, np.ma.MaskedArray):
        return pa.array(values.data, type=_ARROW[column.kind], mask=np.ma.getmaskarray(values))
    return pa.array(values, type=_ARROW[column.kind])
