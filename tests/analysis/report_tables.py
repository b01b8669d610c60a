"""Small tables of runs, campaigns and recorded drives for tests of pages and figures, made without SUMO."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.drive import Drive
from camera_synth.camera import Camera
from plugin.record import Recorder
from plugin.truth import HORIZONS_S

HOSTILE = (
    "</script><script>window.hacked=1</script>",
    '"><img src=x onerror=window.hacked=2>',
    "<!--<script>'$x$ \u2028 & {{ 7*7 }} <b>bold</b>",
)
STEPS = 120


def write_run(
    directory: Path, ids: tuple[str, ...] = ("one", "two", "three"), formats: tuple[str, ...] = ("csv",)
) -> Path:
    """A run of 12 s with these vehicles, each with a drift over its left border, a warning and a conflict."""
    recorder = Recorder("made-1", directory, formats)
    time = np.round(10.0 + 0.1 * np.arange(STEPS), 1)
    for number, name in enumerate(ids):
        recorder.append("steps", _steps(number, name, time))
        recorder.append("predictions", _predictions(number, name, time))
        recorder.append("tracks", _tracks(number, name, time))
        place = {"lane_id": ["lane_0"], "true_x_m": [25.0 * 13.0], "true_y_m": [50.0 * number]}
        event = {"vehicle_id": [name], "start_s": [13.0], "end_s": [14.5], "lead_time_s": [1.0], **place}
        recorder.append(
            "warnings", event | {"kind": ["ldw"], "level": ["warning"], "side": ["left"], "outcome": ["true"]}
        )
        recorder.append("warnings", event | {"kind": ["fcw"], "level": ["danger"], "outcome": ["false"]})
        recorder.append(
            "departures",
            {
                "vehicle_id": [name],
                "side": ["left"],
                "crossing_s": [14.0],
                "cause": ["distraction"],
                "lateral_speed_mps": [0.6],
                "speed_mps": [25.0],
                "warned": [True],
                "lead_time_s": [1.0],
                "in_zone": [True],
                **place,
            },
        )
        recorder.append(
            "conflicts",
            {
                "vehicle_id": [name],
                "target_id": ["ahead"],
                "start_s": [16.0],
                "end_s": [18.0],
                "min_ttc_s": [1.8],
                "min_gap_m": [9.0],
                "critical_s": [17.0],
                "visible_s": [3.0],
                "warned": [True],
                "lead_time_s": [1.5],
                **place,
            },
        )
    recorder.append(
        "runs",
        {"seed": [1], "mode": ["refined"], "configuration_hash": ["0" * 64], "versions": ["made; by hand"]},
    )
    recorder.close()
    return directory


def _steps(number: int, name: str, time: np.ndarray) -> dict[str, object]:
    n = len(time)
    offset = 0.3 * np.sin(time + number) + 1.3 * np.exp(-((time - 14.0) ** 2))
    ttc = np.where(time > 15.0, 2.0 + np.abs(time - 17.0), np.nan)
    near = (time > 12.0) & (time < 14.0)
    return {
        "time_s": time,
        "vehicle_id": [name] * n,
        "lane_id": ["lane_0"] * n,
        "speed_mps": np.full(n, 25.0),
        "true_lateral_offset_m": offset,
        "lateral_offset_m": offset + 0.02,
        "true_heading_error_rad": np.zeros(n),
        "heading_error_rad": np.full(n, 1e-3),
        "true_curvature_1pm": np.full(n, 1e-3 * (number % 2)),
        "true_curvature_here_1pm": np.zeros(n),
        "curvature_1pm": np.zeros(n),
        "lane_width_m": np.full(n, 3.7),
        "true_lane_width_m": np.full(n, 3.75),
        "true_cause": np.where((time > 12.5) & (time < 14.2), "distraction", "lane_keeping").tolist(),
        "lane_locked": np.ones(n, bool),
        "lane_score": np.ones(n),
        "on_marked_road": np.ones(n, bool),
        "recognised": (np.arange(n) % 10 != number).tolist(),
        "true_tlc_s": np.where(near, 14.0 - time, np.nan),
        "tlc_s": np.where(near, 14.1 - time, np.nan),
        "tlc_true_state_s": np.where(near, 14.02 - time, np.nan),
        "tlc_constant_velocity_s": np.where(near, 14.4 - time, np.nan),
        "tlc_constant_radius_s": np.where(near, 14.3 - time, np.nan),
        "tlc_side": np.where(near, "left", None).tolist(),
        "ldw_state": ["ready"] * n,
        "fcw_state": ["ready"] * n,
        "true_ttc_s": ttc,
        "fcw_ttc_s": ttc + 0.1,
        "true_leader_visible": np.ones(n, bool),
        "true_x_m": 25.0 * time,
        "true_y_m": 50.0 * number + offset,
    }


def _predictions(number: int, name: str, time: np.ndarray) -> dict[str, object]:
    horizon = np.tile(HORIZONS_S, len(time))
    error = 0.05 * horizon**2 * np.where(np.arange(len(horizon)) % 2, 1.0, -1.0)
    return {
        "time_s": np.repeat(time, len(HORIZONS_S)),
        "vehicle_id": [name] * len(horizon),
        "horizon_s": horizon,
        "lateral_error_m": error,
        "true_state_lateral_error_m": 0.5 * error,
        "constant_velocity_lateral_error_m": 3.0 * error,
        "constant_radius_lateral_error_m": 2.0 * error,
    }


def _tracks(number: int, name: str, time: np.ndarray) -> dict[str, object]:
    n = len(time)
    state = np.where(np.arange(n) < 60, "same_direction", "stationary").tolist()
    return {
        "time_s": time,
        "vehicle_id": [name] * n,
        "track_id": np.full(n, number + 1),
        "target_id": ["ahead"] * n,
        "measured": np.ones(n, bool),
        "range_m": 60.0 - 2.0 * (time - 10.0),
        "range_rate_mps": np.full(n, -2.0),
        "azimuth_rad": np.zeros(n),
        "x_m": 60.0 - 2.0 * (time - 10.0),
        "y_m": np.zeros(n),
        "motion_state": state,
        "true_motion_state": ["same_direction"] * n,
        "in_path": np.ones(n, bool),
    }


def made_drive(vehicle_id: str = "one", steps: int = 40) -> Drive:
    """A drive whose frames are noise around a bright bar that moves right, its path straight ahead."""
    rng = np.random.default_rng(0)
    time = np.round(10.0 + 0.1 * np.arange(steps), 1)
    frames = rng.integers(60, 90, (steps, 240, 320)).astype(np.uint8)
    for k in range(steps):
        frames[k, :, 5 * k : 5 * k + 20] = 230
    rows = pd.DataFrame(_steps(0, vehicle_id, time))
    rows["ldw_state"] = np.where(rows["time_s"] > 12.0, "warning left", "ready")
    rows["fcw_gap_m"] = 40.0
    tracks = pd.DataFrame(_tracks(0, vehicle_id, time)).assign(vx_mps=20.0, ttc_s=np.nan)
    border_rows = np.arange(0.0, 120.0, 6.0)
    columns = np.stack([0.8 * border_rows - 20.0, 340.0 - 0.8 * border_rows])
    ahead = np.stack([np.arange(1.0, 50.0, 2.5), np.zeros(20)], axis=-1)
    line = np.stack([np.linspace(-10, 120, 15), np.full(15, 1.8)], axis=-1)
    events = pd.DataFrame(
        {"start_s": [12.1], "crossing_s": [12.5], "cause": ["distraction"], "kind": ["ldw"]}
    )
    return Drive(
        vehicle_id=vehicle_id,
        run_id="made-1",
        time_s=time,
        frames=frames,
        steps=rows,
        tracks=tracks,
        warnings=events,
        departures=events,
        conflicts=events.iloc[:0],
        camera=Camera(),
        path_m=np.tile(ahead, (steps, 1, 1)),
        border_px=np.tile(columns, (steps, 1, 1)),
        border_rows=border_rows,
        bodies_m=np.tile([60.0, 0.0, 0.0, 4.5, 1.8], (steps, 1, 1)),
        road_m=np.tile(np.stack([line, line * [1, -1]]), (steps, 1, 1, 1)),
        road_kind=np.tile([[1], [2]], (steps, 1, 15)),
    )


def write_campaign(directory: Path) -> Path:
    """The report of a campaign of two cells, as `sumo-adas batch` and `sweep` leave it."""
    directory.mkdir(parents=True, exist_ok=True)
    about = {"title": f"Made {HOSTILE[0]}", "hash": "0" * 64, "runs": 5}
    (directory / "campaign.json").write_text(json.dumps(about), encoding="utf-8")
    cells = [{"cell": "all"}, {"cell": 0, "condition": "clear"}, {"cell": 1, "condition": HOSTILE[1]}]
    rates, shares, times, predictions, accuracy = [], [], [], [], []
    for k, cell in enumerate(cells):
        for name in ("departures", "departures_missed", "warnings_false", "conflicts", "fcw_danger_false"):
            rates.append(
                cell
                | {"figure": name, "runs": 4, "distance_km": 100.0, "vehicle_hours": 1.0, "count": 3 + k}
                | {"per_100km": 3.0 + k, "per_100km_poisson_low": 1.0, "per_100km_poisson_high": 9.0}
            )
        shares.append(
            cell
            | {"figure": "departures_warned", "of": "departures_due", "count": 9, "number": 10}
            | {"share": 0.9, "low": 0.6, "high": 0.98}
        )
        for name in ("true_tlc", "true_ttc", "ldw_lead_time", "conflict_min_ttc"):
            times += [cell | {"figure": name, "up_to_s": 0.1 * b, "count": b} for b in range(1, 20)]
        for label in ("predicted", "true_state", "constant_velocity", "constant_radius"):
            for h in HORIZONS_S:
                predictions.append(
                    cell
                    | {"horizon_s": h, "predictor": label, "count": 50, "median_m": 0.1 * h, "p95_m": 0.3 * h}
                )
        errors = ("tlc_error", "tlc_true_state_error", "ttc_error")
        accuracy.append(
            cell
            | {
                f"{name}_{end}_s": 0.1 if end == "median" else 0.4
                for name in errors
                for end in ("median", "p95")
            }
        )
    benefit = [
        {
            "condition": "clear",
            "figure": "departures",
            "pairs": 2,
            "without": 9,
            "avoided": 4,
            "avoided_share": 0.44,
        }
        | {"avoided_per_run": 2.0, "avoided_per_run_low": 0.5, "avoided_per_run_high": 3.5}
    ]
    sweep = [
        {"threshold_s": 0.2 * k, "events": 10, "hits": k, "hit_rate": k / 10, "false": k, "nuisance": k}
        | {"false_per_100km": 0.3 * k, "nuisance_per_100km": 1.0 * k}
        for k in range(1, 11)
    ]
    runs = [{"run": f"0-{seed}", "cell": 0, "seed": seed} for seed in (1, 2, 3, 4)]
    failures = [{"run": "1-9", "cause": HOSTILE[2], "attempts": 2}]
    tables = {
        "rates": rates,
        "shares": shares,
        "times": times,
        "predictions": predictions,
        "accuracy": accuracy,
        "benefit": benefit,
        "sweep_ldw": sweep,
        "runs": runs,
        "failures": failures,
        "classes": [cells[0] | {"true": "stationary", "as_stationary": 9}],
    }
    for name, rows in tables.items():
        pd.DataFrame(rows).to_csv(directory / f"{name}.csv", index=False)
    return directory


def write_recording(directory: Path) -> Path:
    """lanes.csv and tracks.csv, as `detect` and `track` leave them."""
    directory.mkdir(parents=True, exist_ok=True)
    time = np.round(0.1 * np.arange(80), 1)
    pd.DataFrame(
        {
            "frame": range(80),
            "time_s": time,
            "lane_locked": (time > 1.0).astype(int),
            "lane_score": np.where(time > 1.0, 0.9, 0.2),
            "lateral_offset_m": np.where(time > 1.0, np.sin(time), np.nan),
            "heading_error_rad": 0.01 * np.cos(time),
            "curvature_1pm": 1e-4 * time,
            "lane_width_m": 3.6,
        }
    ).to_csv(directory / "lanes.csv", index=False)
    tracks = pd.DataFrame(_tracks(0, "own", time + 10.0)).assign(target_id=HOSTILE[0])
    tracks.to_csv(directory / "tracks.csv", index=False)
    return directory
