"""A trial's verdict from the table `steps` of its vehicle: realised values, alert, bounds, margin."""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.protocol.definition import CollisionTest, DepartureTest, QuietTest
from analysis.protocol.planning import LANE_M, Trial
from plugin.warning.safe_distance import time_to_collision
from sumo_net.arrays import Array
from sumo_net.step import STEP_S

_BRAKE_WINDOW = slice(5, 20)  # steps after the start of braking, over which it is averaged


@dataclass(frozen=True, slots=True)
class Verdict:
    """A trial's row of the table; NaN where a column does not apply."""

    test: str
    cell: str
    trial: int
    attempt: int
    vehicle_id: str
    passed: bool
    valid: bool = True
    why: str = ""
    radius_m: float = math.nan
    side: str = ""
    speed_mps: float = math.nan  # realised, mean
    speed_off_mps: float = math.nan  # realised, largest deviation
    drift_wanted_mps: float = math.nan
    drift_mps: float = math.nan  # realised, outwards
    leader_speed_mps: float = math.nan  # realised, at the beginning of the manoeuvre
    leader_braking_mps2: float = math.nan  # realised
    gap_m: float = math.nan  # at the beginning of the manoeuvre
    alert_s: float = math.nan  # since the beginning of the manoeuvre
    alert_kind: str = ""
    distance_to_line_m: float = math.nan  # tyre inside the border at the alert; negative outside
    earliest_m: float = math.nan
    latest_m: float = math.nan
    range_m: float = math.nan  # gap at the alert
    least_range_m: float = math.nan
    followed_from_m: float = math.nan  # gap from which the radar followed the leader
    least_followed_m: float = math.nan
    ttc_s: float = math.nan  # at the alert, at constant speeds
    ttc_accelerated_s: float = math.nan  # with the leader's braking continued
    least_ttc_s: float = math.nan
    margin: float = math.nan  # to the nearest bound, negative beyond it
    margin_unit: str = ""


def judge(
    trial: Trial, steps: pd.DataFrame, tracks: pd.DataFrame, half_span_m: float, front_axle_m: float
) -> Verdict:
    """The verdict on one trial; `steps` and `tracks` are its vehicle's rows, from its first step on."""
    steps = steps.sort_values("time_s")
    test = trial.test
    blank = Verdict(test.name, trial.cell, trial.number, trial.attempt, trial.vehicle_id, False)
    blank = dataclasses.replace(
        blank, radius_m=trial.radius_m, side={1: "left", -1: "right"}.get(trial.side, "")
    )
    begin = round(test.settle_s / STEP_S)
    if len(steps) <= begin:
        return dataclasses.replace(blank, valid=False, why="the vehicle left before the end")
    wanted = test.speed_kmh / 3.6
    speed = steps["speed_mps"].to_numpy(float)
    blank = dataclasses.replace(
        blank, speed_mps=float(speed.mean()), speed_off_mps=float(np.abs(speed - wanted).max())
    )
    if isinstance(test, DepartureTest):
        verdict = _departure(trial, test, steps, half_span_m, front_axle_m, blank)
    elif isinstance(test, QuietTest):
        verdict = _quiet(test, steps, half_span_m, front_axle_m, blank)
    else:
        assert isinstance(test, CollisionTest)
        verdict = _collision(test, steps, tracks, blank)
    if verdict.speed_off_mps > test.speed_tolerance_kmh / 3.6:
        return _invalid(verdict, f"{verdict.speed_off_mps * 3.6:.1f} km/h off the speed")
    return verdict


def tyre_margins_m(steps: pd.DataFrame, half_span_m: float, front_axle_m: float) -> tuple[Array, Array]:
    """From the front wheels' outer edges to the left and right border of the lane, inside positive."""
    heading = steps["true_heading_error_rad"].to_numpy(float)
    axle = steps["true_lateral_offset_m"].to_numpy(float) + front_axle_m * np.sin(heading)
    reach = half_span_m * np.cos(heading)
    return 0.5 * LANE_M - axle - reach, 0.5 * LANE_M + axle - reach


def lateral_rate_mps(steps: pd.DataFrame) -> Array:
    """True lateral speed in the lane, left positive."""
    heading = steps["true_heading_error_rad"].to_numpy(float)
    along, across = steps["speed_mps"].to_numpy(float), steps["true_lateral_speed_mps"].to_numpy(float)
    return np.asarray(along * np.sin(heading) + across * np.cos(heading))


def _departure(
    trial: Trial,
    test: DepartureTest,
    steps: pd.DataFrame,
    half_span_m: float,
    front_axle_m: float,
    blank: Verdict,
) -> Verdict:
    left, right = tyre_margins_m(steps, half_span_m, front_axle_m)
    margin = left if trial.side > 0 else right
    rate = trial.side * lateral_rate_mps(steps)
    begin = round(test.settle_s / STEP_S)
    word = "warning left" if trial.side > 0 else "warning right"
    state = steps["ldw_state"].to_numpy(str)
    active = np.flatnonzero(np.char.startswith(state, "warning"))
    # the trial ends at the latest line, where the truth must still refer to the old lane
    crossed = np.flatnonzero(margin[begin:] <= -test.latest_m)
    end = begin + int(crossed[0]) if len(crossed) else len(steps) - 1
    earliest = test.earliest_at(trial.drift_mps)
    verdict = dataclasses.replace(
        blank, drift_wanted_mps=trial.drift_mps, earliest_m=earliest, latest_m=-test.latest_m, margin_unit="m"
    )
    alert = int(active[0]) if len(active) and active[0] <= end else None
    until = end if alert is None else max(alert, begin + 1)
    window = slice(max(begin, until - round(test.drift_window_s / STEP_S)), until + 1)
    driven = float(rate[window].mean())
    verdict = dataclasses.replace(verdict, drift_mps=driven)
    if alert is None and not len(crossed):
        return _invalid(verdict, "the latest line was not reached")
    if alert is None:
        return dataclasses.replace(verdict, why="no alert", margin=-math.inf)
    off = max(test.drift_tolerance_mps, test.drift_tolerance_share * trial.drift_mps)
    inside = float(margin[alert])
    verdict = dataclasses.replace(
        verdict,
        alert_s=round((alert - begin) * STEP_S, 1),
        alert_kind=state[alert],
        distance_to_line_m=inside,
        margin=min(earliest - inside, inside + test.latest_m),
    )
    if alert <= begin:
        return dataclasses.replace(verdict, why="alert before the departure")
    if state[alert] != word:
        return dataclasses.replace(verdict, why=f"the alert was a {state[alert]}")
    if inside > earliest:
        return dataclasses.replace(verdict, why=f"{inside - earliest:.2f} m too early")
    if abs(driven - trial.drift_mps) > off:
        return _invalid(verdict, f"drifted at {driven:.2f} m/s")
    if inside < -test.latest_m:
        return dataclasses.replace(verdict, why=f"{-test.latest_m - inside:.2f} m too late")
    return dataclasses.replace(verdict, passed=True)


def _quiet(
    test: QuietTest, steps: pd.DataFrame, half_span_m: float, front_axle_m: float, blank: Verdict
) -> Verdict:
    begin = round(test.settle_s / STEP_S)
    nearest = float(np.minimum(*tyre_margins_m(steps, half_span_m, front_axle_m))[begin:].min())
    state = steps["ldw_state"].to_numpy(str)
    active = np.flatnonzero(np.char.startswith(state, "warning"))
    verdict = dataclasses.replace(
        blank, distance_to_line_m=nearest, earliest_m=test.inside_m, margin=nearest, margin_unit="m"
    )
    if nearest < test.inside_m:
        return _invalid(verdict, f"came as near as {nearest:.2f} m to a border")
    if len(active):
        at = (int(active[0]) - begin) * STEP_S
        return dataclasses.replace(
            verdict, why="an alert in the lane", alert_s=round(at, 1), alert_kind=state[active[0]]
        )
    return dataclasses.replace(verdict, passed=True)


def _collision(test: CollisionTest, steps: pd.DataFrame, tracks: pd.DataFrame, blank: Verdict) -> Verdict:
    gap = steps["true_gap_m"].to_numpy(float)
    speed = steps["speed_mps"].to_numpy(float)
    leader = speed + np.gradient(gap, STEP_S)
    state = steps["fcw_state"].to_numpy(str)
    begin = round(test.settle_s / STEP_S) if test.brake_mps2 is not None else 0
    alerts = np.flatnonzero(np.isin(state, ("reminder", "danger")))
    if test.expect == "none":
        if not (tracks["target_id"] == f"{blank.vehicle_id}_leader").any():
            return _invalid(blank, "the radar never saw the vehicle beside")
        if not len(alerts):
            return dataclasses.replace(blank, passed=True)
        first = int(alerts[0])
        return dataclasses.replace(
            blank, why="an alert of a vehicle beside", alert_s=first * STEP_S, alert_kind=state[first]
        )
    verdict = dataclasses.replace(blank, gap_m=float(gap[begin]), margin_unit="s")
    ends = np.flatnonzero(~(gap > 0.0))
    end = int(ends[0]) if len(ends) else len(gap)
    alert = int(alerts[0]) if len(alerts) and alerts[0] < end else None
    verdict = dataclasses.replace(verdict, leader_speed_mps=float(leader[max(begin - 1, 1)]))
    if test.brake_mps2 is not None:
        during = leader[begin:end][_BRAKE_WINDOW]
        braking = (
            -float(np.polyfit(np.arange(len(during)) * STEP_S, during, 1)[0]) if len(during) > 2 else 0.0
        )
        verdict = dataclasses.replace(verdict, leader_braking_mps2=braking)
        if abs(braking - test.brake_mps2) > test.brake_tolerance_share * test.brake_mps2:
            return _invalid(verdict, f"the leader braked at {braking:.2f} m/s²")
    if abs(verdict.leader_speed_mps - test.leader_kmh / 3.6) > test.speed_tolerance_kmh / 3.6:
        return _invalid(verdict, f"the leader drove {verdict.leader_speed_mps * 3.6:.1f} km/h")
    if test.gap_tolerance_m is not None and abs(verdict.gap_m - test.gap_m) > test.gap_tolerance_m:
        return _invalid(verdict, f"{verdict.gap_m:.1f} m behind the leader")
    if alert is None:
        return dataclasses.replace(verdict, why="no alert", margin=-math.inf)
    v, v_l = float(speed[alert]), max(float(leader[alert]), 0.0)
    plain = float(time_to_collision(float(gap[alert]), v, 0.0, v_l, 0.0))
    brake = -test.brake_mps2 if test.brake_mps2 is not None and alert > begin else 0.0
    accelerated = float(time_to_collision(float(gap[alert]), v, 0.0, v_l, brake))
    verdict = dataclasses.replace(
        verdict,
        alert_s=round((alert - begin) * STEP_S, 1),
        alert_kind=state[alert],
        range_m=float(gap[alert]),
        least_range_m=_or_nan(test.latest_range_m(v - v_l)),
        followed_from_m=_followed_from_m(steps, tracks, f"{blank.vehicle_id}_leader", alert),
        least_followed_m=_or_nan(test.detection_range_m(v - v_l)),
        ttc_s=plain,
        ttc_accelerated_s=accelerated,
        least_ttc_s=math.nan if test.ttc_least_s is None else test.ttc_least_s,
    )
    if alert <= begin:
        return dataclasses.replace(verdict, why="alert before the manoeuvre")
    return _timely(verdict, accelerated if test.ttc == "accelerated" else plain)


def _timely(verdict: Verdict, ttc_s: float) -> Verdict:
    """Check that the alert came in time and the leader was followed from far enough away."""
    late, far = ttc_s - verdict.least_ttc_s, verdict.range_m - verdict.least_range_m
    seen = verdict.followed_from_m - verdict.least_followed_m
    if late < 0.0:
        return dataclasses.replace(verdict, margin=late, why=f"{-late:.2f} s too late")
    if far < 0.0:
        return dataclasses.replace(verdict, margin=far, margin_unit="m", why=f"{-far:.1f} m too late")
    if seen < 0.0:
        why = f"followed from {verdict.followed_from_m:.1f} m only"
        return dataclasses.replace(verdict, margin=seen, margin_unit="m", why=why)
    if not math.isnan(late):
        return dataclasses.replace(verdict, margin=late, passed=True)
    margin = min((m for m in (far, seen) if not math.isnan(m)), default=math.nan)
    return dataclasses.replace(verdict, margin=margin, margin_unit="m", passed=True)


def _followed_from_m(steps: pd.DataFrame, tracks: pd.DataFrame, leader: str, alert: int) -> float:
    """The gap from which the leader had a track in every step up to the alert; NaN for none."""
    there = set(tracks.loc[tracks["target_id"] == leader, "time_s"].round(1))
    first = None
    for k in range(alert, -1, -1):
        if round(float(steps["time_s"].iloc[k]), 1) not in there:
            break
        first = k
    return math.nan if first is None else float(steps["true_gap_m"].iloc[first])


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _invalid(verdict: Verdict, why: str) -> Verdict:
    return dataclasses.replace(verdict, valid=False, passed=False, why=f"invalid: {why}")
