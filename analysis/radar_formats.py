"""Converters from other radar log formats to that of `analysis.radar_log`, by name."""

import dataclasses
import logging
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis.radar_log import Log, LogError, parse, read_log, track
from plugin.tracking.filters import FILTERS, FilterSettings
from plugin.tracking.models import RadarNoise
from plugin.tracking.tracker import TrackerSettings
from sumo_net.frames import wrap_angle


class Format(NamedTuple):
    """Reader of a format, and its radar's noise."""

    convert: Callable[[Path], pd.DataFrame]
    noise: RadarNoise


def comma2k19(path: Path) -> pd.DataFrame:
    """A comma2k19 segment: radar.csv, or the folder with it, beside speed.csv and gyro.csv.

    The messages of one 20 Hz cycle are spread over some milliseconds; here they are one scan at their mean
    time. An address that begins a new track becomes ADDRESS.2, .3, … The yaw rate is minus the gyroscope's z
    axis, the one of the three that follows speed times steering angle (correlation −0.92).
    """
    folder = path if path.is_dir() else path.parent
    radar, speed, gyro = (_table(folder / name, columns) for name, columns in _COMMA2K19.items())
    if len(speed) < 2:
        raise LogError(f"{folder / 'speed.csv'}: holds fewer than two rows")
    radar = radar.astype({"address": np.int64, "new_track": np.int64})
    scan = (radar["time_s"].diff() > 0.02).cumsum()
    scan += (radar.groupby([scan, "address"]).cumcount() > 0).cumsum()  # twice an address: a cycle was lost
    time = radar.groupby(scan)["time_s"].transform("mean").round(6)
    life = radar.groupby("address")["new_track"].cumsum() + 1
    target: pd.Series[str] = radar["address"].astype(str) + np.where(life > 1, "." + life.astype(str), "")
    # Means over 0.2 s: of speed for the acceleration, of the gyroscope (100 Hz, shaken) for the yaw rate.
    smooth = speed.set_index("time_s")["speed_mps"].rolling(25, center=True, min_periods=1).mean()
    acceleration = np.gradient(smooth.to_numpy(), smooth.index.to_numpy())
    yaw = -gyro.set_index("time_s")["gyro_z_radps"].rolling(21, center=True, min_periods=1).mean()
    return pd.DataFrame(
        {
            "time_s": time,
            "range_m": np.hypot(radar["forward_m"], radar["left_m"]),
            "range_rate_mps": radar["relative_speed_mps"],
            "azimuth_rad": np.arctan2(radar["left_m"], radar["forward_m"]),
            "target_id": target,
            "ego_speed_mps": np.interp(time, speed["time_s"], speed["speed_mps"]),
            "ego_acceleration_mps2": np.interp(time, smooth.index, acceleration),
            "ego_yaw_rate_rps": np.interp(time, yaw.index, yaw),
        }
    )


def udacity(path: Path) -> pd.DataFrame:
    """The radar rows `R rho phi rho_dot time_us x y vx vy yaw yaw_rate` of the Udacity set, with truth."""
    try:
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(f"{path}: cannot be read ({error})") from None
    for number, line in enumerate(lines, start=1):
        if line and (line[0] not in ("R", "L") or (line[0] == "R" and len(line) != 11)):
            raise LogError(f"{path}:{number}: must be 'L' or 'R' and, for 'R', 10 numbers")
    rows = [line[1:] for line in lines if line and line[0] == "R"]
    names = ["rho", "phi", "rho_dot", "time_us", "x", "y", "vx", "vy", "yaw", "yaw_rate"]
    raw = pd.DataFrame(rows, columns=names).apply(pd.to_numeric, errors="coerce")
    true_range = np.hypot(raw["x"], raw["y"])
    return pd.DataFrame(
        {
            "time_s": (raw["time_us"] - raw["time_us"].min()) * 1e-6,
            "range_m": raw["rho"],
            "range_rate_mps": raw["rho_dot"],
            "azimuth_rad": wrap_angle(raw["phi"].to_numpy(np.float64)),  # exceeds π in the data set
            "target_id": "1",
            "true_range_m": true_range,
            "true_range_rate_mps": (raw["x"] * raw["vx"] + raw["y"] * raw["vy"]) / true_range,
            "true_azimuth_rad": np.arctan2(raw["y"], raw["x"]),
            "true_x_m": raw["x"],
            "true_y_m": raw["y"],
            "true_vx_mps": raw["vx"],
            "true_vy_mps": raw["vy"],
        }
    )


FORMATS: dict[str, Format] = {
    # The object list's second differences show 0.03 m and 0.02 m/s; but as the radar has filtered the list,
    # its noise is not white, hence the far larger values here.
    "comma2k19": Format(comma2k19, RadarNoise(range_m=0.3, range_rate_mps=0.2, azimuth_rad=0.005)),
    "udacity": Format(udacity, RadarNoise(range_m=0.3, range_rate_mps=0.3, azimuth_rad=0.03)),
}


def load(path: Path, name: str = "csv") -> Log:
    """The log at `path` in the format `name` ("csv" or one of FORMATS). Raises LogError."""
    if name == "csv":
        return read_log(path)
    if name not in FORMATS:
        raise LogError(f"format = {name!r}: allowed are csv, {', '.join(FORMATS)}")
    return parse(FORMATS[name].convert(path), f"{path} as {name}")


def track_recording(
    path: Path,
    out: Path | None,
    filter_name: str = "imm",
    from_format: str = "csv",
    own_association: bool = False,
) -> pd.DataFrame:
    """`sumo-adas track PATH --out DIR --filter NAME`: write tracks.csv into `out`, give the table.

    Parameters
    ----------
    from_format : "csv" or one of FORMATS, whose radar noise is then used.
    own_association : ignore given targets and associate.

    Raises LogError (the log) and ValueError (the filter's name).
    """
    if filter_name not in FILTERS:
        raise ValueError(f"filter = {filter_name!r}: allowed are {', '.join(FILTERS)}")
    log = load(path, from_format)
    if log.dropped:
        logging.getLogger(__name__).warning("%s: %d rows repeat others: left out", path, log.dropped)
    noise = FORMATS[from_format].noise if from_format in FORMATS else RadarNoise()
    options = dataclasses.replace(TrackerSettings(filters=FilterSettings(noise=noise)), filter=filter_name)
    return track(log, path.stem, out, options, own_association)


_COMMA2K19 = {
    "radar.csv": ("time_s", "address", "forward_m", "left_m", "relative_speed_mps", "new_track"),
    "speed.csv": ("time_s", "speed_mps"),
    "gyro.csv": ("time_s", "gyro_z_radps"),
}
_MOST = 1e15  # up to here a double still has fractions, and integers are exact


def _table(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    """These columns of a CSV file as finite numbers. Raises LogError, one line."""
    try:
        text = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8-sig", index_col=False)
    except FileNotFoundError:
        raise LogError(f"{path}: no such file") from None
    except (ValueError, OSError) as error:
        raise LogError(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    for name in columns:
        if name not in text:
            raise LogError(f"{path}:1: column {name} is missing")
    if text.empty:
        raise LogError(f"{path}: holds no rows")
    numbers = text[list(columns)].apply(pd.to_numeric, errors="coerce")
    wrong = ~(numbers.abs() < _MOST)
    if wrong.any(axis=None):
        row, column = np.argwhere(wrong.to_numpy())[0]
        value = text[columns[column]].iloc[row]
        raise LogError(f"{path}:{row + 2}: {columns[column]} = {str(value)[:80]!r} must be a finite number")
    return numbers.astype(np.float64)
