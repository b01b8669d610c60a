"""The tables' columns: names with units, types, decimals written, and what they mean.

Later columns may be added; those that stand keep name and meaning. Empty means not applicable, never 0.
"""

from typing import NamedTuple


class Column(NamedTuple):
    """One column. `kind` is float, int, bool or text; floats are rounded to `decimals`."""

    name: str
    description: str
    kind: str = "float"
    decimals: int = 4


def _text(name: str, description: str) -> Column:
    return Column(name, description, "text")


def _flag(name: str, description: str) -> Column:
    return Column(name, description, "bool")


_RUN = _text("run_id", "the run: scenario and seed")
_VEHICLE = _text("vehicle_id", "SUMO's id of the equipped vehicle")
_TIME = Column("time_s", "SUMO time", decimals=2)

TABLES: dict[str, tuple[Column, ...]] = {
    "steps": (
        _RUN,
        _TIME,
        _VEHICLE,
        _text("lane_id", "SUMO's lane"),
        Column("speed_mps", "speed", decimals=3),
        Column("true_lateral_offset_m", "centre of gravity left of the centre of the marked lane it is in"),
        Column("true_heading_error_rad", "vehicle heading minus lane heading, left positive", decimals=6),
        Column(
            "true_curvature_1pm", "lane curvature at the preview point (33.5 m), left positive", decimals=7
        ),
        Column("true_lateral_speed_mps", "v_y of the centre of gravity in the vehicle frame", decimals=5),
        Column("true_yaw_rate_rps", "yaw rate", decimals=6),
        Column("true_steer_rad", "front-wheel steer angle", decimals=6),
        Column(
            "true_tlc_s",
            "time to lane crossing on the path then driven; 0 while a wheel is outside",
            decimals=3,
        ),
        Column("true_cause", "what the driver does: see `cause` of departures", "text"),
        _flag("lane_locked", "the camera sees the lane"),
        Column(
            "left_a", "left border x = a·y² + b·y + c in the 320x240 image, y up from the bottom", decimals=7
        ),
        Column("left_b", "its slope at the bottom row", decimals=5),
        Column("left_c", "its column at the bottom row", decimals=3),
        Column("right_a", "right border", decimals=7),
        Column("right_b", "its slope at the bottom row", decimals=5),
        Column("right_c", "its column at the bottom row", decimals=3),
        Column("lane_score", "0 (nothing seen) to 1"),
        Column("lateral_offset_m", "estimate of true_lateral_offset_m"),
        Column("heading_error_rad", "estimate of true_heading_error_rad", decimals=6),
        Column("curvature_1pm", "estimate of true_curvature_1pm", decimals=7),
        Column("lane_width_m", "estimate of the lane width"),
        Column("lateral_speed_mps", "estimate of v_y", decimals=5),
        Column("yaw_rate_rps", "estimate of the yaw rate", decimals=6),
        Column("steer_rad", "estimate of the front-wheel steer angle", decimals=6),
        Column("tlc_s", "time to lane crossing on the predicted path; empty beyond the horizon", decimals=3),
        _text("tlc_side", "left or right"),
        Column("tlc_constant_velocity_s", "the same with constant lateral velocity (baseline)", decimals=3),
        Column("tlc_constant_radius_s", "the same with constant turn radius (baseline)", decimals=3),
        Column(
            "tlc_true_state_s",
            "the same predictor fed with the true state (the driver's own floor)",
            decimals=3,
        ),
        _flag("ldw_active", "a lane-departure warning is given"),
        _text("ldw_state", "inactive, ready, warning left, warning right, suppressed, lane not seen"),
        Column("true_curvature_here_1pm", "lane curvature at the centre of gravity", decimals=7),
        _flag("on_marked_road", "truth: the lane has a painted marking on both sides"),
        _flag("recognised", "both borders within 5 px/cosθ on 85 % of the rows where the marking shows"),
        _flag("paper_recognised", "the same for the published search, where it runs beside"),
        _text("fcw_state", "inactive, ready, reminder, danger, suppressed (the driver brakes)"),
        Column("fcw_track_id", "the track in path, see `tracks`", "int"),
        Column("fcw_gap_m", "estimated gap to it, bumper to bumper", decimals=2),
        Column("fcw_relative_speed_mps", "estimated; negative when closing", decimals=2),
        Column("fcw_ttc_s", "estimated time to collision; empty where the gap opens", decimals=3),
        Column("fcw_reminder_m", "safe distance of the reminder", decimals=2),
        Column("fcw_danger_m", "safe distance of danger", decimals=2),
        _flag("fcw_lamp_reminder", "the yellow lamp"),
        _flag("fcw_lamp_danger", "the red lamp"),
        _text("fcw_buzzer", "silent, chime, alarm"),
        Column("fcw_shown_distance_m", "on the driver's display", decimals=0),
        Column("fcw_shown_relative_speed_mps", "on the driver's display", decimals=0),
        Column("true_gap_m", "to the leader on SUMO's lane, bumper to bumper", decimals=3),
        Column("true_ttc_s", "true time to collision with it; empty where the gap opens", decimals=3),
        _flag("true_leader_visible", "it reaches into the lane driven in and is in the radar's view"),
        Column("true_x_m", "centre of gravity in SUMO's network, east", decimals=3),
        Column("true_y_m", "north", decimals=3),
        Column("true_lane_width_m", "width of the marked lane it is in", decimals=3),
        Column("fcw_track_ttc_s", "as fcw_ttc_s, by the radar's track alone", decimals=3),
    ),
    "predictions": (
        _RUN,
        _TIME,
        _VEHICLE,
        Column("horizon_s", "how far ahead", decimals=2),
        Column("lateral_error_m", "predicted minus driven position, across the driven path, left positive"),
        Column("longitudinal_error_m", "along it"),
        Column("heading_error_rad", "predicted minus driven heading", decimals=6),
        Column("constant_velocity_lateral_error_m", "baseline: constant lateral velocity"),
        Column("constant_radius_lateral_error_m", "baseline: constant turn radius"),
        Column("true_state_lateral_error_m", "the same predictor fed with the true state"),
    ),
    "warnings": (
        _RUN,
        _VEHICLE,
        _text("kind", "ldw or fcw"),
        _text("level", "ldw: warning; fcw: reminder or danger"),
        _text("side", "left or right; empty for fcw"),
        Column("start_s", "first step of the warning", decimals=2),
        Column("end_s", "last step; empty when the run ended during it", decimals=2),
        Column("tlc_s", "estimated time to lane crossing at the start", decimals=3),
        Column("ttc_s", "estimated time to collision at the start", decimals=3),
        Column("lead_time_s", "from the start to the crossing or conflict", decimals=3),
        _text("outcome", "true (it came to it), nuisance (the driver corrected), false (no such drift)"),
    ),
    "tracks": (
        _RUN,
        _TIME,
        _VEHICLE,
        Column("track_id", "number of the track within the vehicle, never used again", "int"),
        _text("target_id", "SUMO's id of what was detected last; roadside:N beside the road; empty: clutter"),
        _flag("measured", "a detection of this scan was taken; otherwise the track coasts"),
        Column("range_m", "from the radar", decimals=2),
        Column("range_rate_mps", "positive: opening", decimals=2),
        Column("azimuth_rad", "left positive", decimals=5),
        Column("x_m", "ahead of the centre of gravity", decimals=2),
        Column("y_m", "left of it", decimals=2),
        Column("vx_mps", "over ground, in the vehicle's axes", decimals=2),
        Column("vy_mps", "over ground, in the vehicle's axes", decimals=2),
        Column("ax_mps2", "over ground", decimals=2),
        Column("ay_mps2", "over ground", decimals=2),
        Column("probability_cv", "of constant velocity; empty where the filter has no such mode", decimals=3),
        _text(
            "motion_state",
            "unclassified, stationary, same_direction, oncoming, stopped_was_same_direction, "
            "stopped_was_oncoming",
        ),
        _flag("in_path", "in the path of the vehicle; the nearest one is the warning's target"),
        Column("ttc_s", "range over closing speed; empty where the range opens", decimals=3),
        Column("restarts", "how often the filter's covariance was lost and begun anew", "int"),
        Column("true_range_m", "of the point that was detected; empty while the track coasts", decimals=2),
        Column("true_range_rate_mps", "of that point", decimals=2),
        Column("true_azimuth_rad", "of that point", decimals=5),
        Column("true_vx_mps", "of the body over ground, in the vehicle's axes", decimals=2),
        Column("true_vy_mps", "of the body over ground, in the vehicle's axes", decimals=2),
        _text("true_motion_state", "the class by the true velocities since the track began"),
    ),
    "conflicts": (
        _RUN,
        _VEHICLE,
        _text("target_id", "SUMO's id of its leader"),
        Column("start_s", "first step with a true time to collision under 3 s", decimals=2),
        Column("end_s", "last one", decimals=2),
        Column("min_ttc_s", "least true time to collision", decimals=3),
        Column("min_gap_m", "least true gap, bumper to bumper", decimals=3),
        Column(
            "critical_s",
            "when the true time to collision fell under 2 s; empty where it did not",
            decimals=2,
        ),
        Column("visible_s", "so long had it been in path and in the radar's view by then", decimals=2),
        _flag("warned", "a warning of either level was on by then (or by the least TTC)"),
        Column("lead_time_s", "from the warning's start to then; negative for a late one", decimals=3),
    ),
    "departures": (
        _RUN,
        _VEHICLE,
        _text("side", "left or right"),
        Column("crossing_s", "when a front wheel's outer edge met the border", decimals=3),
        _text(
            "cause", "lane_keeping, distraction, microsleep, lane_change_signalled, lane_change_unsignalled"
        ),
        Column("lateral_speed_mps", "towards the border, when crossing"),
        Column("speed_mps", "speed when crossing", decimals=3),
        _flag(
            "warned",
            "a warning for this side began before the crossing; empty where none is due: signalled, slow",
        ),
        Column("lead_time_s", "from that warning to the crossing; negative for a late one", decimals=3),
        _flag("in_zone", "the warning began inside the placement zone (ISO 17361, from memory)"),
    ),
    "runs": (
        _RUN,
        Column("seed", "of equipment, drivers and sensors (and of SUMO, where it was started here)", "int"),
        _text("mode", "paper or refined"),
        _text("configuration_hash", "SHA-256 of all settings"),
        _text("versions", "of this project, SUMO, Python, NumPy, Numba and OpenCV"),
        Column("begin_s", "SUMO time of the first recorded step", decimals=2),
        Column("end_s", "of the last one", decimals=2),
        Column("vehicles", "equipped vehicles that were on the road", "int"),
        Column("vehicle_steps", "rows of `steps`", "int"),
        Column("distance_km", "driven by equipped vehicles"),
        Column("departures", "crossings without a turn signal", "int"),
        Column("warnings", "lane-departure warnings", "int"),
        Column("conflicts", "rear-end conflicts: a true time to collision under 3 s", "int"),
        Column("collision_warnings", "rear-end warnings of the reminder level", "int"),
    ),
}
