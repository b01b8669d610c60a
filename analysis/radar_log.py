"""Tracking on recorded radar logs: `sumo-adas track LOG.csv --out DIR --filter NAME`.

A log is a CSV file with one row per detection and the columns of `REQUIRED`; the rows of one scan have the
same time, and a row with only a time is a scan without detections. Optional are `target_id` (association
given; it is copied to the output), the ego motion (missing columns: a radar at rest) and truth columns
`true_…`, which need a target_id and are copied beside the estimates.
"""

import csv
import difflib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from plugin.record import Recorder
from plugin.schema import Column
from plugin.tracking import classification
from plugin.tracking.detections import Detections, EgoMotion
from plugin.tracking.tracker import Tracker, TrackerSettings, TrackList
from sumo_net.arrays import Array
from sumo_net.frames import wrap_angle
from sumo_net.settings import InputError

REQUIRED = ("time_s", "range_m", "range_rate_mps", "azimuth_rad")
EGO = ("ego_speed_mps", "ego_acceleration_mps2", "ego_yaw_rate_rps")
TRUE = (
    "true_range_m",
    "true_range_rate_mps",
    "true_azimuth_rad",
    "true_x_m",
    "true_y_m",
    "true_vx_mps",
    "true_vy_mps",
)
_MOST_STEP_S = 10.0  # of half the scans; tracks end long before
KNOWN = (*REQUIRED, "target_id", *EGO, *TRUE)

COLUMNS = (
    Column("run_id", "the log", "text"),
    Column("time_s", "as in the log", decimals=6),
    Column("vehicle_id", "ego", "text"),
    Column("track_id", "number of the track, never used again", "int"),
    Column("target_id", "as given in the log; with --own-association, of the detection in this scan", "text"),
    Column("measured", "a detection of this scan was assigned", "bool"),
    Column("range_m", "from the radar"),
    Column("range_rate_mps", "positive: opening"),
    Column("azimuth_rad", "left positive", decimals=6),
    Column("x_m", "ahead of the radar"),
    Column("y_m", "left"),
    Column("vx_mps", "over ground, in the vehicle's axes"),
    Column("vy_mps", ""),
    Column("ax_mps2", "over ground"),
    Column("ay_mps2", ""),
    Column("probability_cv", "of the constant-velocity mode; empty where the filter has none"),
    Column("motion_state", ", ".join(classification.NAMES), "text"),
    Column("ttc_s", "range over closing speed; empty where the range opens", decimals=3),
    Column("restarts", "how often the filter's covariance was lost and reset", "int"),
    *(Column(name, "as given in the log", decimals=6) for name in TRUE),
)


class LogError(InputError):
    """An error in a log, with file, line and column."""


class Log(NamedTuple):
    """S scans with D detections."""

    time_s: Array  # (S,)
    first: Array  # (S + 1,) int64: scan s has the detections first[s]:first[s + 1]
    detections: Detections  # owner 0; label is an index into `targets`
    ego: EgoMotion  # (S,) each
    targets: tuple[str, ...]
    truth: pd.DataFrame  # time_s, target_id and the existing true_ columns; empty if there are none
    dropped: int  # exact duplicates of other rows


def read_log(path: Path) -> Log:
    """Read and check a log. Raises LogError, one line with file, line and column."""
    try:
        with warnings.catch_warnings(record=True) as odd:
            warnings.simplefilter("always", pd.errors.ParserWarning)
            frame = pd.read_csv(
                path,
                dtype=str,
                keep_default_na=False,
                skip_blank_lines=False,
                encoding="utf-8-sig",
                index_col=False,
            )
    except FileNotFoundError:
        raise LogError(f"{path}: no such file") from None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({error.strerror})") from None
    except pd.errors.EmptyDataError:
        raise LogError(f"{path}:1: is empty; the first line must be {','.join(REQUIRED)}") from None
    except (pd.errors.ParserError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: is not a CSV file: {' '.join(str(error).split())}") from None
    if odd:
        _check_widths(path, len(frame.columns))
    frame.columns = frame.columns.str.strip()
    return parse(frame.fillna(""), str(path))


def parse(frame: pd.DataFrame, source: str) -> Log:
    """Check a log given as text or numbers; row i is line i + 2 of `source`. Raises LogError."""
    _check_columns(frame, source)
    text = frame.astype(str).apply(lambda column: column.str.strip())
    text = text[(text != "").any(axis=1)]  # drop blank lines; the index keeps the line number
    if text.empty:
        raise LogError(f"{source}:{len(frame) + 2}: holds no rows")
    used = [name for name in KNOWN if name in text]
    rows = text[used].drop_duplicates()
    values = {name: _numbers(rows, name, source) for name in used if name != "target_id"}
    _check_values(rows, values, source)
    time, scan_of_row = np.unique(values["time_s"], return_inverse=True)
    if len(time) > 1 and np.median(np.diff(time)) > _MOST_STEP_S:
        raise LogError(
            f"{source}: scans are {np.median(np.diff(time)):.4g} s apart, at most {_MOST_STEP_S:g} can be "
            "tracked: is time_s in milliseconds or microseconds?"
        )
    speed, acceleration, yaw_rate = (_per_scan(rows, values, name, scan_of_row, source) for name in EGO)
    names = rows["target_id"].to_numpy() if "target_id" in rows else np.full(len(rows), "")
    real = np.isfinite(values["range_m"])
    _check_targets(rows, values["time_s"], names, source)
    targets, label = np.unique(names, return_inverse=True)
    label = np.where(names == "", -1, label)[real]
    truth = {name: values[name] for name in TRUE if name in values}
    return Log(
        time,
        np.searchsorted(scan_of_row[real], np.arange(len(time) + 1)),
        Detections(
            np.zeros(int(real.sum()), np.int64),
            values["range_m"][real],
            values["range_rate_mps"][real],
            values["azimuth_rad"][real],
            label,
        ),
        EgoMotion(speed, acceleration, yaw_rate, np.zeros(len(time))),
        tuple(targets),
        pd.DataFrame({"time_s": values["time_s"], "target_id": names} | truth)[
            real & (names != "") & bool(truth)
        ],
        len(text) - len(rows),
    )


def tracks(log: Log, options: TrackerSettings, own_association: bool = False) -> Iterator[dict[str, Any]]:
    """The confirmed tracks after each scan, as columns of `COLUMNS` without truth.

    `own_association` ignores the given targets; a row then names that of the detection assigned to it.
    """
    tracker = Tracker(options)
    state = tracker.init(1)
    before = log.time_s[0]
    for s, time in enumerate(log.time_s):
        scan = slice(log.first[s], log.first[s + 1])
        seen = Detections(*(part[scan] for part in log.detections))
        given = seen.label
        if own_association:
            seen = seen._replace(label=np.full_like(given, -1))
        ego = EgoMotion(*(part[s : s + 1] for part in log.ego))
        state, listed = tracker.step(state, seen, ego, float(time - before))
        if own_association:
            listed = listed._replace(label=np.append(given, -1)[listed.detection])
        before = time
        yield _columns(log, time, listed)


def track(
    log: Log, name: str, out: Path | None, options: TrackerSettings, own_association: bool = False
) -> pd.DataFrame:
    """Track a log called `name`; write tracks.csv into `out` if given; return the table."""
    memory = Recorder(name, tables={"tracks": COLUMNS})
    recorders = [memory] if out is None else [memory, Recorder(name, out, tables={"tracks": COLUMNS})]
    truth = {time: group.set_index("target_id") for time, group in log.truth.groupby("time_s")}
    for columns in tracks(log, options, own_association):
        time = columns["time_s"][0] if len(columns["time_s"]) else None
        if time in truth:
            beside = truth[time].drop(columns="time_s").reindex(columns["target_id"])
            columns |= {column: beside[column].to_numpy() for column in TRUE if column in beside}
        for recorder in recorders:
            recorder.append("tracks", columns)
    for recorder in recorders:
        recorder.close()
    return memory.table("tracks")


def rmse(table: pd.DataFrame) -> dict[str, float]:
    """Root mean square error of every estimate that has a truth column."""
    out = {}
    for name in TRUE:
        error = (table[name.removeprefix("true_")] - table[name]).to_numpy()
        if "azimuth" in name:
            error = wrap_angle(error)
        if np.isfinite(error).any():
            out[name.removeprefix("true_")] = float(np.sqrt(np.nanmean(error**2)))
    return out


def _columns(log: Log, time: float, listed: TrackList) -> dict[str, Any]:
    shown = np.flatnonzero(listed.confirmed)
    estimate = {name: part[shown] for name, part in listed.estimate._asdict().items()}
    closing = -estimate["range_rate_mps"]
    names = np.array([*log.targets, ""], dtype=object)  # label -1 gives the last, ''
    return estimate | {
        "time_s": np.full(len(shown), time),
        "vehicle_id": np.full(len(shown), "ego", dtype=object),
        "track_id": listed.track_id[shown],
        "target_id": names[listed.label[shown]],
        "measured": listed.detection[shown] >= 0,
        "motion_state": np.array(classification.NAMES, dtype=object)[listed.motion_state[shown]],
        "ttc_s": np.where(closing > 0.0, estimate["range_m"] / np.where(closing > 0.0, closing, 1.0), np.nan),
        "restarts": listed.restarts[shown],
    }


def _check_widths(path: Path, columns: int) -> None:
    """pandas leaves out what is more than the first line has names for; empty fields may be left out."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file)
        for row in rows:
            if any(value.strip() for value in row[columns:]):
                raise LogError(
                    f"{path}:{rows.line_num}: holds {len(row)} values for {columns} columns: "
                    "decimals need a point, not a comma"
                )


def _check_columns(frame: pd.DataFrame, source: str) -> None:
    given = list(frame.columns)
    for name in REQUIRED:
        if name not in given:
            raise LogError(f"{source}:1: column {name} is missing; there are {_named(*given)}")
    for name in given:
        if given.count(name) > 1 or f"{name}.1" in given:
            raise LogError(f"{source}:1: column {_named(name)} is given twice")
        near = difflib.get_close_matches(str(name), [k for k in KNOWN if k not in given], n=1, cutoff=0.75)
        if name not in KNOWN and near:
            raise LogError(f"{source}:1: column {_named(name)} is unknown: did you mean {near[0]}?")


def _named(*columns: object) -> str:
    """Names from a file made printable: short, without control characters."""
    return ", ".join(repr(str(name)[:60]).strip("'\"") for name in columns[:40])


def _numbers(rows: pd.DataFrame, name: str, source: str) -> Array:
    """A column as numbers; NaN for permitted empty cells."""
    may_be_empty = name in REQUIRED[1:] or name in TRUE
    numbers = pd.to_numeric(rows[name], errors="coerce").to_numpy(np.float64)
    wrong = ~np.isfinite(numbers)
    if may_be_empty:
        wrong &= (rows[name] != "").to_numpy()
    _refuse(wrong, rows, name, source, "must be a finite number")
    return numbers


def _check_values(rows: pd.DataFrame, values: dict[str, Array], source: str) -> None:
    empty = np.stack([np.isnan(values[name]) for name in REQUIRED[1:]])
    for name, missing in zip(REQUIRED[1:], empty, strict=True):
        partly = missing & ~empty.all(axis=0)
        _refuse(partly, rows, name, source, "must be given (or range, rate and azimuth all be left empty)")
    backward = np.diff(values["time_s"], prepend=-np.inf) < 0.0
    _refuse(backward, rows, "time_s", source, "must not be before the line above: times must be sorted")
    _refuse(values["range_m"] < 0.0, rows, "range_m", source, "must not be negative")
    beyond = np.abs(values["azimuth_rad"]) > np.pi
    _refuse(beyond, rows, "azimuth_rad", source, "must lie within ±π; is it in degrees?")


def _check_targets(rows: pd.DataFrame, time: Array, names: Array, source: str) -> None:
    pairs = pd.DataFrame({"time": time, "name": names})
    again = pairs.duplicated().to_numpy() & (names != "")
    _refuse(again, rows, "time_s", source, "is repeated for the same target_id with other values")


def _per_scan(
    rows: pd.DataFrame, values: dict[str, Array], name: str, scan_of_row: Array, source: str
) -> Array:
    """An ego column by scan (S,); zeros if the log has none."""
    if name not in values:
        return np.zeros(scan_of_row.max() + 1)
    first = np.flatnonzero(np.diff(scan_of_row, prepend=-1))
    differs = values[name] != values[name][first][scan_of_row]
    _refuse(differs, rows, name, source, "must be the same in all rows of one scan")
    return np.asarray(values[name][first])


def _refuse(wrong: Array, rows: pd.DataFrame, name: str, source: str, rule: str) -> None:
    """Raise LogError for the first wrong row."""
    if wrong.any():
        line = rows.index[int(np.argmax(wrong))]
        raise LogError(f"{source}:{line + 2}: {name} = {str(rows.loc[line, name])[:80]!r} {rule}")
