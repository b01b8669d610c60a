"""The tables' columns: names with units, types, decimals written, and what they mean.

Columns may be added; existing ones keep name and meaning. Empty means not applicable, never 0.
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


def _place(when: str) -> tuple[Column, ...]:
    return (
        _text("lane_id", f"SUMO's lane of the vehicle {when}, as in `steps`"),
        Column("true_x_m", "its centre of gravity then, in SUMO's network, x (east)", decimals=3),
        Column("true_y_m", "and y (north)", decimals=3),
    )


TABLES: dict[str, tuple[Column, ...]] = {
    "steps": (
        _RUN,
        _TIME,
        _VEHICLE,
        _text(
            "lane_id",
            "SUMO's lane, which changes before or after the marked lane that the vehicle is in; "
            "ends in ` against` where it overtakes on a lane of the opposite direction",
        ),
        Column("speed_mps", "speed", decimals=3),
        Column(
            "true_lateral_offset_m", "centre of gravity, left of the centre of the marked lane that it is in"
        ),
        Column("true_heading_error_rad", "vehicle heading minus lane heading, left positive", decimals=6),
        Column(
            "true_curvature_1pm",
            "lane curvature at the preview point (33.5 m), left positive; empty where the road ends or has "
            "turned away by then",
            decimals=7,
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
            "left_a",
            "left border x = a·y² + b·y + c in the 320x240 image, y up from the bottom; empty also where it "
            "runs beside the image",
            decimals=7,
        ),
        Column("left_b", "left border: slope at the bottom row", decimals=5),
        Column("left_c", "left border: image column at the bottom row", decimals=3),
        Column("right_a", "right border, as left_a", decimals=7),
        Column("right_b", "right border: slope at the bottom row", decimals=5),
        Column("right_c", "right border: image column at the bottom row", decimals=3),
        Column("lane_score", "0 (nothing seen) to 1"),
        Column("lateral_offset_m", "estimate of true_lateral_offset_m"),
        Column("heading_error_rad", "estimate of true_heading_error_rad", decimals=6),
        Column("curvature_1pm", "estimate of true_curvature_1pm", decimals=7),
        Column("lane_width_m", "estimate of the lane width"),
        Column("lateral_speed_mps", "estimate of v_y", decimals=5),
        Column("yaw_rate_rps", "estimate of the yaw rate", decimals=6),
        Column("steer_rad", "estimate of the front-wheel steer angle", decimals=6),
        Column(
            "tlc_s",
            "time to lane crossing on the predicted path; empty beyond the horizon; known up to 1 s after "
            "the lane was last seen",
            decimals=3,
        ),
        _text("tlc_side", "side of that crossing: left or right"),
        Column("tlc_constant_velocity_s", "tlc_s of the baseline with constant lateral velocity", decimals=3),
        Column("tlc_constant_radius_s", "tlc_s of the baseline with constant turn radius", decimals=3),
        Column(
            "tlc_true_state_s",
            "tlc_s of the same predictor fed with the true state (what the driver makes unpredictable)",
            decimals=3,
        ),
        _flag("ldw_active", "a lane-departure warning is given"),
        _text("ldw_state", "inactive, ready, warning left, warning right, suppressed, lane not seen"),
        Column("true_curvature_here_1pm", "lane curvature at the centre of gravity", decimals=7),
        _flag("on_marked_road", "truth: the lane has a painted marking on both sides"),
        _flag("recognised", "both borders within 5 px/cosθ on 85 % of the rows where the marking is visible"),
        _flag("paper_recognised", "recognised by the published search, where it runs on the same frames"),
        _text(
            "fcw_state",
            "inactive, ready, reminder, danger, suppressed (the driver brakes: no sound, no red lamp; with "
            "the yellow lamp on it is a reminder)",
        ),
        Column("fcw_track_id", "the target: the nearest track in path, see `tracks`", "int"),
        Column("fcw_gap_m", "estimated gap to that track, bumper to bumper", decimals=2),
        Column("fcw_relative_speed_mps", "estimated relative speed; negative when closing", decimals=2),
        Column("fcw_ttc_s", "estimated time to collision; empty where the gap opens", decimals=3),
        Column("fcw_reminder_m", "safe distance of the reminder level", decimals=2),
        Column("fcw_danger_m", "safe distance of the danger level", decimals=2),
        _flag("fcw_lamp_reminder", "the yellow lamp is on"),
        _flag("fcw_lamp_danger", "the red lamp is on"),
        _text("fcw_buzzer", "the buzzer: silent, chime, alarm"),
        Column("fcw_shown_distance_m", "distance on the driver's display", decimals=0),
        Column("fcw_shown_relative_speed_mps", "relative speed on the driver's display", decimals=0),
        Column("true_gap_m", "true gap to the leader on SUMO's lane, bumper to bumper", decimals=3),
        Column(
            "true_ttc_s",
            "true time to collision with that leader; empty unless the gap closes by 1 mm/s",
            decimals=3,
        ),
        _flag(
            "true_leader_visible",
            "that leader reaches into the lane that is driven in, and is in the radar's view",
        ),
        Column("true_x_m", "centre of gravity in SUMO's network, x (east)", decimals=3),
        Column("true_y_m", "centre of gravity in SUMO's network, y (north)", decimals=3),
        Column("true_lane_width_m", "width of the marked lane that the vehicle is in", decimals=3),
        Column("fcw_track_ttc_s", "fcw_ttc_s computed from the radar track alone", decimals=3),
        _flag("true_leader_overlapped", "another vehicle's body overlaps that leader, as after a collision"),
    ),
    "predictions": (
        _RUN,
        _TIME,
        _VEHICLE,
        Column("horizon_s", "how far ahead", decimals=2),
        Column("lateral_error_m", "predicted minus driven position, across the driven path, left positive"),
        Column("longitudinal_error_m", "the same, along the driven path"),
        Column("heading_error_rad", "predicted minus driven heading", decimals=6),
        Column(
            "constant_velocity_lateral_error_m",
            "lateral error of the baseline with constant lateral velocity",
        ),
        Column("constant_radius_lateral_error_m", "lateral error of the baseline with constant turn radius"),
        Column("true_state_lateral_error_m", "lateral error of the same predictor fed with the true state"),
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
        _text(
            "outcome",
            "true (the crossing or conflict followed), nuisance (one was approached and avoided), false",
        ),
        *_place("at the start"),
    ),
    "tracks": (
        _RUN,
        _TIME,
        _VEHICLE,
        Column("track_id", "number of the track within the vehicle, never reused", "int"),
        _text(
            "target_id", "SUMO's id of the object detected last; roadside:N beside the road; empty: clutter"
        ),
        _flag("measured", "a detection of this scan was assigned; otherwise the track coasts"),
        Column("range_m", "distance from the radar", decimals=2),
        Column("range_rate_mps", "rate of the range; positive: opening", decimals=2),
        Column("azimuth_rad", "bearing from the radar, left positive", decimals=5),
        Column("x_m", "distance ahead of the own centre of gravity", decimals=2),
        Column("y_m", "distance left of the own centre of gravity", decimals=2),
        Column("vx_mps", "velocity over ground, along the own vehicle's x axis", decimals=2),
        Column("vy_mps", "velocity over ground, along the own vehicle's y axis", decimals=2),
        Column("ax_mps2", "acceleration over ground, x axis", decimals=2),
        Column("ay_mps2", "acceleration over ground, y axis", decimals=2),
        Column(
            "probability_cv",
            "probability of the constant-velocity model; empty where the filter has none",
            decimals=3,
        ),
        _text(
            "motion_state",
            "unclassified, stationary, same_direction, oncoming, stopped_was_same_direction, "
            "stopped_was_oncoming",
        ),
        _flag("in_path", "in the path of the vehicle; the nearest one is the warning's target"),
        Column("ttc_s", "range over closing speed; empty where the range opens", decimals=3),
        Column("restarts", "how often the filter lost its covariance and was restarted", "int"),
        Column(
            "true_range_m", "range of the point that was detected; empty while the track coasts", decimals=2
        ),
        Column("true_range_rate_mps", "range rate of that point", decimals=2),
        Column("true_azimuth_rad", "azimuth of that point", decimals=5),
        Column("true_vx_mps", "velocity of the body over ground, own x axis", decimals=2),
        Column("true_vy_mps", "velocity of the body over ground, own y axis", decimals=2),
        _text("true_motion_state", "the class by the true velocities since the track began"),
    ),
    "conflicts": (
        _RUN,
        _VEHICLE,
        _text("target_id", "SUMO's id of the leader"),
        Column("start_s", "first step with a true time to collision under 3 s", decimals=2),
        Column("end_s", "last such step", decimals=2),
        Column("min_ttc_s", "least true time to collision", decimals=3),
        Column("min_gap_m", "least true gap, bumper to bumper", decimals=3),
        Column(
            "critical_s",
            "when the true time to collision fell under 2 s; empty where it did not",
            decimals=2,
        ),
        Column(
            "visible_s",
            "how long the leader had been in path and in the radar's view at critical_s",
            decimals=2,
        ),
        _flag("warned", "a warning of either level was on by critical_s (or by the least TTC)"),
        Column(
            "lead_time_s", "from the warning's start to that moment; negative for a late warning", decimals=3
        ),
        *_place("at the start"),
    ),
    "departures": (
        _RUN,
        _VEHICLE,
        _text("side", "left or right"),
        Column("crossing_s", "when a front wheel's outer edge met the border", decimals=3),
        _text(
            "cause", "lane_keeping, distraction, microsleep, lane_change_signalled, lane_change_unsignalled"
        ),
        Column("lateral_speed_mps", "lateral speed towards the border at the crossing"),
        Column("speed_mps", "speed at the crossing", decimals=3),
        _flag(
            "warned",
            "a warning for this side began before the crossing; empty where none is due (signalled or slow)",
        ),
        Column("lead_time_s", "from that warning to the crossing; negative for a late warning", decimals=3),
        _flag("in_zone", "the warning began inside the placement zone (ISO 17361, from memory)"),
        *_place("in the step after the crossing"),
    ),
    "runs": (
        _RUN,
        Column(
            "seed",
            "random seed of equipment, drivers and sensors (and of SUMO, where it was started here)",
            "int",
        ),
        _text("mode", "paper or refined"),
        _text("configuration_hash", "SHA-256 of all settings"),
        _text("versions", "versions of this project, SUMO, Python, NumPy, Numba and OpenCV"),
        Column("begin_s", "SUMO time of the first recorded step", decimals=2),
        Column("end_s", "SUMO time of the last recorded step", decimals=2),
        Column("vehicles", "number of equipped vehicles that were on the road", "int"),
        Column("vehicle_steps", "number of rows of `steps`", "int"),
        Column("distance_km", "distance driven by equipped vehicles"),
        Column("departures", "number of crossings without a turn signal", "int"),
        Column("warnings", "number of lane-departure warnings", "int"),
        Column("conflicts", "number of rear-end conflicts: a true time to collision under 3 s", "int"),
        Column("collision_warnings", "number of rear-end warnings of the reminder level", "int"),
        _text(
            "equipped_by_class",
            "how many of all vehicles of a SUMO class were equipped: `passenger 2 of 9; …`",
        ),
    ),
}
