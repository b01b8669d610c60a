"""Kernel of the lane-departure warning over the fleet: one small state machine for each vehicle."""

import math
from typing import NamedTuple

from sumo_net.compile import kernel

INACTIVE, READY, WARNING_LEFT, WARNING_RIGHT, SUPPRESSED, LANE_NOT_SEEN = range(6)


class DepartureNumbers(NamedTuple):
    """The warning's settings as kernels take them; see `DepartureSettings` for those of the same name."""

    threshold_s: float
    hysteresis_s: float
    confirm_s: float
    consistent_s: float
    unseen_m: float
    edge_m: float
    least_drift_mps: float
    earliest_m: float
    earliest_time_s: float
    earliest_most_m: float
    latest_m: float
    rearm_gap_m: float
    rearm_s: float
    urgent_s: float
    speed_on_mps: float  # slowest active speed …
    speed_off_mps: float  # … of a warning that is active already
    signal_hold_s: float
    least_duration_s: float
    most_duration_s: float
    step_s: float


@kernel
def due(tlc, gap, drift, c):  # type: ignore[no-untyped-def]
    """Whether a warning is due towards one side, by its TLC, wheel gap and rate of departure (outwards)."""
    if drift < c.least_drift_mps or gap < -c.latest_m:
        return False
    earliest = min(max(c.earliest_m, c.earliest_time_s * drift), c.earliest_most_m)
    return gap <= c.edge_m or (tlc <= c.threshold_s and gap <= earliest)


@kernel
def near(tlc, gap, c):  # type: ignore[no-untyped-def]
    """Whether a warning may be due one step later, as before any true warning."""
    return tlc <= c.threshold_s + c.confirm_s or gap <= 2.0 * c.edge_m


@kernel
def painted(border, other, c):  # type: ignore[no-untyped-def]
    """Whether a border is known from paint beside the vehicle, its own or that of the lane's other border.

    Both in metres driven since paint was seen nearby. A border whose paint is worn off stands where the other
    one and the lane's width place it; but one whose paint was never nearby since the lane was found does not.
    """
    return min(border, other) <= c.unseen_m and border < math.inf


@kernel
def step(state, crossing, drift, settled, shift, unseen, speed, signal, c, new, out):  # type: ignore[no-untyped-def]
    """One step for n vehicles; the new DepartureState into `new`, DepartureWarning into `out`.

    drift (n,) m/s, left positive; settled (n,) s that the estimate is without contradiction; shift (n,) lanes
    that the offset moved by; unseen : metres driven since paint of the left (n,) and the right border (n,)
    was seen nearby; signal (n,) +1 left, -1 right.
    """
    for i in range(speed.size):
        v, code = speed[i], READY
        fast = v >= (c.speed_off_mps if state.fast[i] else c.speed_on_mps)
        seen = not math.isnan(crossing.tlc_s[i])
        if not fast:
            code = INACTIVE
        elif not seen:
            code = LANE_NOT_SEEN
        active, since = state.active[i], state.since_s[i] + c.step_s
        served_left, served_right = state.served_left[i], state.served_right[i]
        hold_left = c.signal_hold_s if signal[i] > 0 else state.hold_left_s[i] - c.step_s
        hold_right = c.signal_hold_s if signal[i] < 0 else state.hold_right_s[i] - c.step_s
        crossed = state.crossed[i]
        if shift[i] != 0:
            crossed = -1 if shift[i] > 0 else 1
            # In another lane now: the border just crossed is behind, and its approach was warned of.
            served_left = served_right = True
        near_left = near_right = False
        started, level = 0, 0

        if seen:
            left, right = crossing.left_s[i], crossing.right_s[i]
            gap_left, gap_right = crossing.gap_left_m[i], crossing.gap_right_m[i]
            sure = settled[i] >= c.consistent_s - 1e-9
            due_left = sure and due(left, gap_left, drift[i], c) and state.near_left[i]
            due_right = sure and due(right, gap_right, -drift[i], c) and state.near_right[i]
            due_left = due_left and painted(unseen[0][i], unseen[1][i], c)
            due_right = due_right and painted(unseen[1][i], unseen[0][i], c)
            near_left, near_right = near(left, gap_left, c), near(right, gap_right, c)
            # Back inside: by rearm_gap at any time, or by edge if the last warning is long ago.
            inside = c.edge_m if since >= c.rearm_s - 1e-9 else c.rearm_gap_m
            clear = c.threshold_s + c.hysteresis_s
            # The border just crossed counts again once the wheel is past it and moves on.
            over_left = crossed > 0 and gap_left > 0.0 and drift[i] < 0.0
            over_right = crossed < 0 and gap_right > 0.0 and drift[i] > 0.0
            if over_left or over_right:
                crossed = 0
            served_left = served_left and not (over_left or (gap_left >= inside and left > clear))
            served_right = served_right and not (over_right or (gap_right >= inside and right > clear))
        else:
            left = right = gap_left = gap_right = math.inf
            due_left = due_right = False

        if active != 0:
            gap = gap_left if active > 0 else gap_right
            time = left if active > 0 else right
            outward = drift[i] * active
            over = shift[i] != 0 or gap < -c.latest_m
            goes_on = (time <= c.threshold_s + c.hysteresis_s and outward > -c.least_drift_mps) or gap <= 0.0
            timely = since < c.most_duration_s - 1e-9
            if not fast or not timely or (since >= c.least_duration_s - 1e-9 and (over or not goes_on)):
                active = 0
        if active == 0 and fast and seen:
            if due_left and not served_left:
                if hold_left > 1e-9:
                    code = SUPPRESSED
                else:
                    active, started, since, served_left = 1, 1, 0.0, True
            if due_right and not served_right:
                if hold_right > 1e-9:
                    code = SUPPRESSED
                elif active == 0:
                    active, started, since, served_right = -1, -1, 0.0, True
        if active != 0:
            code = WARNING_LEFT if active > 0 else WARNING_RIGHT
            gap = gap_left if active > 0 else gap_right
            time = left if active > 0 else right
            level = 2 if gap <= 0.0 or time <= c.urgent_s else 1

        new.crossed[i] = crossed
        new.fast[i], new.active[i], new.since_s[i] = fast, active, since
        new.served_left[i], new.served_right[i] = served_left, served_right
        new.hold_left_s[i], new.hold_right_s[i] = max(hold_left, 0.0), max(hold_right, 0.0)
        new.near_left[i], new.near_right[i] = near_left, near_right
        out.code[i], out.side[i], out.started[i], out.level[i] = code, active, started, level
