"""The three road runs of Zhang et al. 2011, section 4.2, figures 17 to 19, on a road that is rendered here.

Half load at 90 km/h; half load from 80 km/h at 0.2 m/s²; full load from 70 km/h at 0.18 m/s². The road is a
straight that turns into a bend of R 1000 m (the source's mean curvature, 0.001) and back; several cars drive
it, each with its own slight weave. Every 0.1 s a frame is rendered from the true pose, and the published
chain (search, bank, steer held) and the refined chain process the same frames. Neither knows the load: f and
the models are those of half load, as in the source. Scored are the observed position in the lane, v_y and γ,
and the path predicted 2 s ahead against the one driven. The source prints figures of 20 samples (2 s) each
without numbers, and claims that full load is observed a little worse.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis.published import comparison
from analysis.published.road_drives import (
    AHEAD,
    CAMERA,
    HALF,
    RUNS,
    RoadRuns,
    Run,
    Truth,
    driven,
    frames_of,
    still_step,
    truth_of,
)
from camera_synth.camera import PROCESSED_FROM, projection
from camera_synth.render import new_frames
from camera_synth.truth import new_border_columns
from plugin.lane import genetic, refine
from plugin.lane.detector import parabola_columns
from plugin.lane.estimate import BORDER_Y, LaneEstimate
from plugin.lane.genetic import fitted_to, search_numbers
from plugin.lane.geometry import lane_estimate_from_borders, marking_centres
from plugin.motion import observer, prediction
from plugin.motion.estimate import MotionEstimate, Trajectory
from plugin.motion.observer import ObserverSettings
from plugin.motion.prediction import PredictionSettings
from plugin.recognition_kernels import judge
from plugin.vision import SHARE, TOLERANCE_PX
from sumo_net.arrays import Array
from sumo_net.randomness import stream_key
from sumo_net.road import OWN_RIGHT
from sumo_net.step import STEP_S

CHAINS = ("paper", "refined")


class Measured(NamedTuple):
    """Results of the runs."""

    steps: pd.DataFrame  # one row per run, chain, car and 0.1 s
    paths: pd.DataFrame  # car 0's driven and predicted 2 s from STILL_S on: one row per run, path, 0.1 s


class _Chain:
    """One chain from frames to paths, for all cars of a run."""

    def __init__(self, name: str, keys: Array, schedule: observer.Schedule) -> None:
        n = len(keys)
        self._paper = name == "paper"
        self._search, self._lane = genetic.init(keys), refine.init(n)
        self._numbers = search_numbers(fitted_to(genetic.GeneticSearch(), CAMERA))
        self._schedule = schedule
        self._state = observer.init(n, self._schedule)
        self._predictor = prediction.predictor(HALF, PredictionSettings(mode=name))  # type: ignore[arg-type]

    def step(self, frames: Array, speed: Array) -> tuple[Array, LaneEstimate, MotionEstimate, Trajectory]:
        """Columns of the borders found (cars, 2, rows), lane, motion, path."""
        if self._paper:
            self._search, borders = genetic.search(frames, self._search, self._numbers)
            lane = lane_estimate_from_borders(borders, self._search.shifted, CAMERA)
            columns = parabola_columns(marking_centres(borders, CAMERA))
        else:
            start, wanted = None, refine.needs_search(self._lane)
            if wanted.any():
                self._search, start = genetic.search(frames, self._search, self._numbers)
            settings_ = refine.Refine()
            self._lane, lane = refine.step(
                frames, start, wanted, self._lane, projection(CAMERA), speed, settings_
            )
            columns = refine.border_columns(self._lane, BORDER_Y, projection(CAMERA))
        self._state, motion = observer.step(self._state, self._schedule, lane, speed)
        return columns, lane, motion, prediction.predict(motion, speed, self._predictor)


def measure(experiment: RoadRuns) -> Measured:
    """True and observed position and motion, and errors of the path 2 s ahead.

    `lateral_error_m` is across the vehicle's true direction 2 s later, as in the table `predictions`;
    `true_state_lateral_error_m` that of the same predictor from the true state (the run's own vehicle model).
    """
    tables, paths = [], []
    schedules = {
        name: observer.schedule(HALF, CAMERA.preview_m, ObserverSettings(mode=name))  # type: ignore[arg-type]
        for name in CHAINS
    }
    for run in RUNS:
        truth = truth_of(run, experiment)
        paths.append(_points(run, "driven", *driven(truth, still_step(experiment))))
        n, count = experiment.cars, round(experiment.duration_s / STEP_S)
        keys = np.array([stream_key(experiment.seed, f"car {i}", "search") for i in range(n)], np.uint64)
        chains, frames = {name: _Chain(name, keys, schedules[name]) for name in CHAINS}, new_frames(n)
        for k in range(count):
            borders, own = new_border_columns(n), np.full(n, OWN_RIGHT)
            frames_of(truth, experiment, k, frames, PROCESSED_FROM, (own, borders))
            speed = np.ascontiguousarray(truth.drive.speed_mps[k])
            for name, chain in chains.items():
                columns, lane, motion, path = chain.step(frames, speed)
                verdict = np.empty(n, np.int8)
                judge(borders.column, borders.painted, columns, TOLERANCE_PX, SHARE, verdict)
                rows = _rows(run, name, truth, k, lane, motion, path)
                tables.append(rows.assign(recognised=np.where(verdict < 0, np.nan, verdict)))
                if k == still_step(experiment):
                    paths.append(_points(run, name, path.forward_m[0, :AHEAD], path.left_m[0, :AHEAD]))
    return Measured(pd.concat(tables, ignore_index=True), pd.concat(paths, ignore_index=True))


def _points(run: Run, name: str, forward: Array, left: Array) -> pd.DataFrame:
    ahead_s = STEP_S * np.arange(1, len(forward) + 1)
    return pd.DataFrame(
        {"run": run.title, "path": name, "ahead_s": ahead_s, "forward_m": forward, "left_m": left}
    )


def _rows(
    run: Run, chain: str, truth: Truth, k: int, lane: LaneEstimate, motion: MotionEstimate, path: Trajectory
) -> pd.DataFrame:
    t, at = truth.drive, AHEAD - 1
    here = MotionEstimate(
        t.lateral_speed_mps[k],
        t.yaw_rate_rps[k],
        t.steer_rad[k],
        np.zeros_like(t.steer_rad[k]),
        t.offset_m[k],
        t.heading_rad[k],
        t.curvature_1pm[k],
        t.curvature_rate_1pm2[k],
        np.full_like(t.steer_rad[k], 3.75),
        np.full_like(t.steer_rad[k], np.inf),
        np.zeros(len(t.steer_rad[k]), np.int8),
    )
    speed = np.ascontiguousarray(t.speed_mps[k])
    predictor = prediction.predictor(run.vehicle, PredictionSettings(mode=chain))  # type: ignore[arg-type]
    floor = prediction.predict(MotionEstimate(*map(np.ascontiguousarray, here)), speed, predictor)
    paths = {
        "lateral_error_m": path,
        "true_state_lateral_error_m": floor,
        "constant_velocity_lateral_error_m": prediction.constant_velocity(motion, speed, predictor),
        "constant_radius_lateral_error_m": prediction.constant_radius(motion, speed, predictor),
    }
    return pd.DataFrame(
        {
            "run": run.title,
            "chain": chain,
            "car": np.arange(len(speed)),
            "time_s": t.time_s[k],
            "locked": lane.locked,
            "true_lateral_offset_m": t.offset_m[k],
            "lateral_offset_m": motion.lateral_offset_m,
            "true_lateral_speed_mps": t.lateral_speed_mps[k],
            "lateral_speed_mps": motion.lateral_speed_mps,
            "true_yaw_rate_rps": t.yaw_rate_rps[k],
            "yaw_rate_rps": motion.yaw_rate_rps,
        }
        | {name: _across(one, at, truth, k) for name, one in paths.items()}
    )


def _across(path: Trajectory, at: int, truth: Truth, k: int) -> Array:
    dx, dy = truth.x_m[k + AHEAD] - truth.x_m[k], truth.y_m[k + AHEAD] - truth.y_m[k]
    heading = truth.world_heading_rad[k]
    ahead = path.forward_m[:, at] - (np.cos(heading) * dx + np.sin(heading) * dy)
    aside = path.left_m[:, at] - (np.cos(heading) * dy - np.sin(heading) * dx)
    turn = truth.world_heading_rad[k + AHEAD] - heading
    return np.asarray(np.cos(turn) * aside - np.sin(turn) * ahead)


def compare(step: pd.DataFrame, settle_s: float = RoadRuns().settle_s) -> pd.DataFrame:
    """Figures of every run and chain; the source prints none."""
    late = step[step["time_s"] >= settle_s - 1e-9]
    rows = []
    for (run, chain), one in late.groupby(["run", "chain"], sort=False):
        offset = _rms(one["lateral_offset_m"] - one["true_lateral_offset_m"])
        slip = _rms(one["lateral_speed_mps"] - one["true_lateral_speed_mps"])
        yaw = _rms(one["yaw_rate_rps"] - one["true_yaw_rate_rps"])
        for figure, unit, value in (
            ("borders recognised", "%", 100.0 * one["recognised"].mean()),
            ("lane locked", "%", 100.0 * one["locked"].mean()),
            ("observed offset, RMSE", "m", offset),
            ("observed v_y, RMSE", "m/s", slip),
            ("observed γ, RMSE", "rad/s", yaw),
            ("path 2 s ahead, median", "m", one["lateral_error_m"].abs().median()),
            ("path 2 s ahead, 95 %", "m", one["lateral_error_m"].abs().quantile(0.95)),
            ("… from the true state, median", "m", one["true_state_lateral_error_m"].abs().median()),
            ("… constant velocity, median", "m", one["constant_velocity_lateral_error_m"].abs().median()),
            ("… constant radius, median", "m", one["constant_radius_lateral_error_m"].abs().median()),
        ):
            rows.append(comparison.row(str(run), f"{figure}, {chain}", unit, float(value)))
    return comparison.table(rows)


def _rms(error: pd.Series) -> float:
    return float(np.sqrt((error**2).mean()))


def reproduce(out: Path, experiment: RoadRuns | None = None) -> pd.DataFrame:
    """Write road_steps.csv, road_paths.csv, two pictures and the comparison; return the comparison."""
    from analysis.plots.style import save
    from analysis.published import road_frames

    experiment = experiment or RoadRuns()
    measured = measure(experiment)
    tables = {"road_steps.csv": measured.steps, "road_paths.csv": measured.paths}
    result = comparison.write(out, "road", tables, compare(measured.steps, experiment.settle_s))
    save(road_frames.draw(measured.paths, experiment), out / "road_frames.png", "png")
    return result
