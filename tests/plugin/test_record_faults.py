"""Tables when the process is killed or the disk is full or read-only: written rows stay complete."""

import errno
import os
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest

from plugin.record import Recorder, read_table
from plugin.schema import Column

ROWS = 400
SCHEMA = {
    name: (Column("run_id", "", "text"), Column("time_s", ""), Column("speed_mps", ""))
    for name in ("steps", "predictions")
}


def block(k: int, rows: int = ROWS) -> dict[str, np.ndarray]:
    """The rows of one flush."""
    return {"time_s": k + np.arange(rows) / rows, "speed_mps": np.full(rows, float(k))}


def times(directory: Path, name: str = "steps") -> list[float]:
    return read_table(directory, name)["time_s"].tolist()


@pytest.fixture(autouse=True)
def _schema(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("plugin.record.TABLES", SCHEMA)


@pytest.mark.parametrize("aside", [False, True])
@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_what_was_written_is_there_without_a_close(tmp_path: Path, form: str, aside: bool) -> None:
    recorder = Recorder("r", tmp_path, (form,), SCHEMA, aside)
    assert times(tmp_path) == []
    for k in range(3):
        recorder.append("steps", block(k))
        if aside:
            recorder.flush()
        assert len(times(tmp_path)) == (k + 1) * ROWS
    before = read_table(tmp_path, "steps")
    recorder.close()
    recorder.close()
    pd.testing.assert_frame_equal(read_table(tmp_path, "steps"), before)
    assert {file.name for file in tmp_path.iterdir()} == {f"steps.{form}", f"predictions.{form}"}


def test_a_killed_parquet_run_leaves_whole_files(tmp_path: Path) -> None:
    recorder = Recorder("r", tmp_path, ("parquet",), SCHEMA)
    recorder.append("steps", block(0))
    recorder.append("steps", block(1))
    parts = tmp_path / "steps.parquet.parts"
    (parts / "unfinished").write_bytes(b"PAR1 cut sho")  # what a kill within a flush leaves
    assert len(times(tmp_path)) == 2 * ROWS
    whole = [pyarrow.parquet.read_table(part).num_rows for part in sorted(parts.glob("*.parquet"))]
    assert whole == [ROWS, ROWS]
    Recorder("r", tmp_path, ("parquet",), SCHEMA).close()  # the next run into the same directory begins anew
    assert times(tmp_path) == []


@pytest.mark.parametrize("cut", [1, 7, 20])
def test_a_row_that_was_cut_short_is_left_out(tmp_path: Path, cut: int) -> None:
    with (tmp_path / "steps.csv").open("wb") as file:
        file.write(b"run_id,time_s,speed_mps\nr,0.1,1\nr,0.2,1\nr,123.456,25.0"[: -cut or None])
    assert times(tmp_path)[:2] == [0.1, 0.2][: len(times(tmp_path))]
    assert len(times(tmp_path)) == (2 if cut < 15 else 1)


def fill(directory: Path, form: str) -> None:
    """In a process whose files cannot grow beyond 30 kB, as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, 30_000))
    generator = np.random.default_rng(1)
    recorder = Recorder("r", directory, (form,), SCHEMA)
    written = 0
    try:
        for k in range(50):
            rows = block(k) | {"speed_mps": generator.normal(size=ROWS)}
            for name in SCHEMA:
                recorder.append(name, rows)
            written += 1
    except OSError as error:
        print(written, error)
        try:
            recorder.append("steps", block(99))  # what comes after is not put behind a gap
            recorder.close()
        except OSError as again:
            print("close", again.errno)


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_on_a_full_disk_the_blocks_before_are_whole(tmp_path: Path, form: str) -> None:
    code = (
        "import plugin.record; from tests.plugin import test_record_faults as t; from pathlib import Path; "
    )
    code += f"plugin.record.TABLES = t.SCHEMA; t.fill(Path({str(tmp_path)!r}), {form!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    if form == "parquet":  # a part is under the limit, the whole is not
        assert done.stdout == "", done.stdout
        return
    written = int(done.stdout.split()[0])
    assert written > 0
    assert os.strerror(errno.EFBIG) in done.stdout
    assert "steps.csv" in done.stdout
    assert "earlier rows are complete" in done.stdout
    assert len(times(tmp_path)) == written * ROWS
    assert (tmp_path / "steps.csv").read_bytes().endswith(b"\n")


def test_a_failure_is_told_with_the_next_rows_or_at_the_end(tmp_path: Path) -> None:
    for again in (True, False):
        busy = threading.Event()
        recorder = Recorder("r", tmp_path, ("csv",), SCHEMA, aside=True)
        assert recorder._thread is not None
        (writer,) = recorder._writers["steps"]
        writer._file.close()  # type: ignore[union-attr]
        writer._file = (tmp_path / "steps.csv").open("rb", buffering=0)  # type: ignore[union-attr]
        recorder._thread.submit(busy.wait)
        recorder.append("steps", block(0))
        busy.set()
        recorder._thread.submit(int).result()
        if again:
            with pytest.raises(OSError, match="earlier rows are complete"):
                recorder.append("predictions", block(0))
            recorder.close()
        else:
            with pytest.raises(OSError, match=r"steps\.csv"):
                recorder.close()
        assert times(tmp_path) == []


def test_killed_at_a_random_moment_every_table_reads(tmp_path: Path) -> None:
    code = "import plugin.record, sys; from tests.plugin import test_record_faults as t\n"
    code += "from pathlib import Path\nplugin.record.TABLES = t.SCHEMA\n"
    code += "r = plugin.record.Recorder('r', Path(sys.argv[1]),"
    code += " ('csv', 'parquet'), t.SCHEMA, True)\nfor k in range(10**6):\n"
    code += "    [r.append(name, t.block(k)) for name in t.SCHEMA]\n    r.flush()\n    print(k, flush=True)"
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for _ in range(30):
        last = process.stdout.readline()
    process.send_signal(signal.SIGKILL)
    rest = process.communicate()[0].splitlines()
    said = int((rest or [last])[-1])
    for name in SCHEMA:
        for form in ("parquet", "csv"):
            read = times(tmp_path, name)
            assert len(read) >= (said + 1) * ROWS
            assert len(read) % ROWS == 0 or form == "csv"
            assert read == sorted(read)
            if form == "parquet":
                for part in (tmp_path / f"{name}.parquet.parts").iterdir():
                    part.unlink()


def test_a_directory_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        Recorder("r", tmp_path / "file" / "out", ("csv",), SCHEMA)


def test_where_one_file_fails_the_other_has_the_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: object, table: object) -> None:
        raise OSError("no space")

    monkeypatch.setattr("plugin.record._CsvFile.write", full)
    recorder = Recorder("run", tmp_path, ("csv", "parquet"), SCHEMA)
    with pytest.raises(OSError, match="no space"):
        recorder.append("steps", block(0))
    recorder.close()
    assert times(tmp_path) == block(0)["time_s"].tolist()
