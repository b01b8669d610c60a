"""Kernels of the rear-end warning: who is in path, and one small state machine a vehicle."""

import math
from typing import NamedTuple

import numpy as np

from plugin.tracking.classification_kernels import ONCOMING, STATIONARY, STOPPED_ONCOMING, UNCLASSIFIED
from plugin.warning.safe_distance import SafeNumbers, safe_distances, time_to_collision
from sumo_net.compile import kernel

INACTIVE, READY, REMINDER, DANGER, SUPPRESSED = range(5)
SILENT, CHIME, ALARM = range(3)
NONE = -1
_LOOKS = 20.0
_SEEN_FROM_M = 10.0  # nearer bodies reach beyond the image
_LEAST_SPEED_MPS = 3.0  # slower, the yaw rate says nothing about the bend


class PathNumbers(NamedTuple):
    """In-path selection's settings as kernels take them; see `Collision` for those of the same name."""

    enter_m: float
    leave_m: float
    half_lane_m: float
    stationary_half_m: float
    stationary_reach_s: float
    stationary_furthest_m: float
    stationary_steps: int
    sightings: int
    sight_m: float
    unsighted_reach_s: float
    sight_share: float
    sight_memory_steps: float
    curvature_doubt_1pm: float
    lost_reach_s: float
    bumper_m: float
    entry_gap_m: float
    near_slope: float  # tangent of near_angle_rad
    near_half_m: float
    road_reach_m: float
    disagreement_mps2: float
    jerk_mps3: float
    entering_s: float
    guess_reach_s: float


class CollisionNumbers(NamedTuple):
    """The warning's settings as kernels take them; see `Collision` for those of the same name."""

    safe: SafeNumbers
    speed_on_mps: float  # slowest active speed …
    speed_off_mps: float  # … of a warning that is active already
    relief: float
    confirm_steps: int
    least_reminder_s: float
    least_danger_s: float
    brakes_mps2: float  # negative
    least_closing_mps: float
    floor_ttc_s: float
    acceleration_slack_mps2: float
    hardest_mps2: float  # negative
    bumper_m: float
    step_s: float


@kernel
def road_offset(x, y, offset, heading, curvature, rate, reach):  # type: ignore[no-untyped-def]
    """Metres left of the lane's middle of a point in the vehicle frame; left positive.

    offset, heading : of the vehicle in the lane. The lane is the circle of its curvature here, exactly, plus
    what the curvature's change moves it by: K' s up to `reach` metres, constant beyond.
    """
    c, s = math.cos(heading), math.sin(heading)
    u, w = c * x - s * y, s * x + c * y + offset
    square = (curvature * u) ** 2 + (1.0 - curvature * w) ** 2
    d = (2.0 * w - curvature * (u * u + w * w)) / (1.0 + math.sqrt(square))
    station = math.hypot(u, w)
    bend = curvature * u / max(1.0 - curvature * w, 0.1)
    if abs(bend) > 1e-9:
        station = math.atan(bend) / curvature
    inside = min(max(station, 0.0), reach)
    beyond = max(station - reach, 0.0)
    swing = inside**3 / 6.0 + beyond * inside**2 / 2.0 + beyond**2 * inside / 2.0
    return d - rate * swing


@kernel
def kinds(tracks, unseen, sighted_id, latest):  # type: ignore[no-untyped-def]
    """Of tracks (TrackList): detected now; usable as a target, lately detected and not oncoming; never seen
    moving; sighted, which the camera of vehicle i did with its track sighted_id[i] (n,).
    """
    count = len(tracks.owner)
    detected, usable = np.empty(count, np.bool_), np.empty(count, np.bool_)
    standing, sighted = np.empty(count, np.bool_), np.empty(count, np.bool_)
    for t in range(count):
        state = tracks.motion_state[t]
        detected[t] = tracks.detection[t] >= 0
        usable[t] = tracks.confirmed[t] and unseen[t] <= latest and state not in (ONCOMING, STOPPED_ONCOMING)
        standing[t] = state in (STATIONARY, UNCLASSIFIED)
        sighted[t] = sighted_id[tracks.owner[t]] == tracks.track_id[t]
    return detected, usable, standing, sighted


@kernel
def time_to(x, vx, row, speed, bumper):  # type: ignore[no-untyped-def]
    """Time to collision (n,) with the tracks `row` (n,), -1 for none; x, vx (T,) of all, speed (n,)."""
    out = np.full(len(row), math.nan)
    for i in range(len(row)):
        if row[i] != NONE:
            gap, closing = max(x[row[i]] - bumper, 0.0), max(speed[i], 0.0) - max(vx[row[i]], 0.0)
            out[i] = gap / closing if closing > 0.0 else math.inf
    return out


@kernel
def _entered(motion, i, speed, within):  # type: ignore[no-untyped-def]
    """Metres from the middle of the lane to that of the one that vehicle i will be in `within` s, else 0."""
    width, aside = motion.lane_width_m[i], motion.lateral_offset_m[i]
    aside += within * (speed * math.sin(motion.heading_error_rad[i]) + motion.lateral_speed_mps[i])
    if aside > 0.5 * width:
        return width
    return -width if aside < -0.5 * width else 0.0


@kernel
def _between(d, end):  # type: ignore[no-untyped-def]
    """The number between 0 and `end` that is nearest to d."""
    return min(max(d, min(end, 0.0)), max(end, 0.0))


@kernel
def sight_shares(tracks, watched, share, memory_steps, now):  # type: ignore[no-untyped-def]
    """How often the cameras of n vehicles see the rears that they look at, (n,) 0 to 1, into `now`.

    watched (n,) int64 : the track looked at, -1 for none that counts; share (n,) a step ago: a running mean
    over _LOOKS looks that fades with a time constant of `memory_steps` without them.
    """
    for i in range(share.size):
        now[i] = share[i] * (1.0 - 1.0 / (_LOOKS if watched[i] != NONE else memory_steps))
    for t in range(tracks.owner.size):
        i = tracks.owner[t]
        if tracks.sighted[t] and tracks.track_id[t] == watched[i]:
            now[i] += 1.0 / _LOOKS


@kernel
def _remember(new, i, track_id, steps, sighted):  # type: ignore[no-untyped-def]
    """Note in CollisionState `new` a track of vehicle i that is where the path is."""
    for k in range(new.inside.shape[1]):
        if new.inside[i, k] == NONE:
            new.inside[i, k], new.waited[i, k], new.sightings[i, k] = track_id, steps, sighted
            return


@kernel
def in_path(tracks, motion, speed, yaw_rate, p, state, new, nearest, inside, offset):  # type: ignore[no-untyped-def]
    """Which tracks are in path, into inside (T,) bool, and how far from its middle, offset (T,).

    state, new (CollisionState) : of it the tracks that were where the path is, for how many steps, and how
    often they were sighted; those that are go into `new`, with `inside` -1 before. nearest (n,) int64, -1
    before : the row of the nearest of them, whether it counts or not.
    """
    for t in range(tracks.owner.size):
        i = tracks.owner[t]
        inside[t], offset[t] = False, math.nan
        x, y = tracks.x_m[t], tracks.y_m[t]
        if x <= 0.0 or not math.isfinite(x + y):
            continue
        steps, sighted = 0, int(tracks.sighted[t])
        for k in range(state.inside.shape[1]):
            if state.inside[i, k] == tracks.track_id[t]:
                steps, sighted = state.waited[i, k], sighted + state.sightings[i, k]
        if not tracks.usable[t]:
            if steps > 0:  # detected again, it is where it was: nearer than `entry` it could not enter
                _remember(new, i, tracks.track_id[t], steps, sighted)
            continue
        seen = math.isfinite(
            motion.lateral_offset_m[i]
            + motion.heading_error_rad[i]
            + motion.curvature_1pm[i]
            + motion.curvature_rate_1pm2[i]
            + motion.lane_width_m[i]
        )
        bend = yaw_rate[i] / speed[i] if speed[i] >= _LEAST_SPEED_MPS else 0.0
        if speed[i] >= _LEAST_SPEED_MPS:
            seen = seen and abs(motion.curvature_1pm[i] - bend) * speed[i] ** 2 <= p.disagreement_mps2
            seen = seen and abs(motion.curvature_rate_1pm2[i]) * speed[i] ** 3 <= p.jerk_mps3
        if seen:
            half = 0.5 * motion.lane_width_m[i]
            d = road_offset(
                x, y, motion.lateral_offset_m[i], motion.heading_error_rad[i], motion.curvature_1pm[i],
                motion.curvature_rate_1pm2[i], p.road_reach_m,
            )  # fmt: skip
        else:
            half = p.half_lane_m
            d = road_offset(x, y, 0.0, 0.0, bend, 0.0, p.road_reach_m)
        offset[t] = d
        known = steps > 0
        doubt = 0.5 * p.curvature_doubt_1pm * x * x  # how far off a wrong curvature puts the lane there
        close = x <= p.guess_reach_s * speed[i]
        aside = d - _between(d, _entered(motion, i, speed[i], p.entering_s) if seen and close else 0.0)
        inside[t] = abs(aside) <= (half + p.leave_m if known else half - p.enter_m) - doubt
        # Beside the front, at the edge of the view, positions are poor: an object there is being passed.
        inside[t] = inside[t] and (known or x - p.bumper_m >= p.entry_gap_m)
        inside[t] = inside[t] and abs(y) <= p.near_half_m + p.near_slope * max(x - p.bumper_m, 0.0)
        if inside[t] and tracks.standing[t]:
            inside[t] = abs(d) <= p.stationary_half_m - doubt
        if inside[t] and not seen:
            inside[t] = x - p.bumper_m <= p.lost_reach_s * max(speed[i], _LEAST_SPEED_MPS)
        if not inside[t]:
            continue
        if nearest[i] == NONE or x < tracks.x_m[nearest[i]]:
            nearest[i] = t
        if tracks.standing[t]:
            # A path that swings for a moment meets posts far ahead; one straight on meets those at corners,
            # where a camera that sees other vehicles sees none.
            inside[t] = close or steps + 1 >= p.stationary_steps
            inside[t] = inside[t] and x <= min(p.stationary_reach_s * speed[i], p.stationary_furthest_m)
            looked = x <= p.sight_m and x - p.bumper_m > p.unsighted_reach_s * speed[i]
            if looked and new.sight_share[i] >= p.sight_share and sighted < p.sightings:
                inside[t] = False
            elif inside[t]:
                sighted = p.sightings  # it stays a target
        _remember(new, i, tracks.track_id[t], steps + 1, min(sighted, p.sightings))


@kernel
def step(state, tracks, inside, speed, acceleration, c, new, out):  # type: ignore[no-untyped-def]
    """One step for n vehicles; the new CollisionState into `new`, CollisionWarning into `out`.

    out.row is -1 before. tracks (Targets) in any order, inside (T,) bool.
    """
    n = speed.size
    for t in range(tracks.owner.size):
        if inside[t]:
            i = tracks.owner[t]
            if out.row[i] == NONE or tracks.x_m[t] < tracks.x_m[out.row[i]]:
                out.row[i] = t
    for i in range(n):
        v, a = max(speed[i], 0.0), acceleration[i]
        fast = v >= (c.speed_off_mps if state.fast[i] else c.speed_on_mps)
        level, since, since_danger = state.level[i], state.since_s[i] + c.step_s, state.danger_s[i] + c.step_s
        hits, hits_danger = 0, 0
        wanted, hold, suppressed = 0, 0, False
        t = out.row[i]
        out.track_id[i] = NONE
        out.gap_m[i] = out.relative_mps[i] = out.ttc_s[i] = out.ttc_accelerated_s[i] = math.nan
        out.reminder_m[i] = out.danger_m[i] = math.nan
        if t != NONE:
            gap = max(tracks.x_m[t] - c.bumper_m, 0.0)
            v_l = max(tracks.vx_mps[t], 0.0)
            # The leader's acceleration counts where it brakes, beyond what the track's noise may feign.
            a_l = (
                min(tracks.ax_mps2[t] + c.acceleration_slack_mps2, 0.0)
                if math.isfinite(tracks.ax_mps2[t])
                else 0.0
            )
            a_l = max(a_l, c.hardest_mps2)
            reminder, danger = safe_distances(v, min(a, 0.0), v_l, a_l, c.safe)
            closing = v - v_l
            out.track_id[i], out.gap_m[i], out.relative_mps[i] = tracks.track_id[t], gap, -closing
            out.ttc_s[i] = time_to_collision(gap, v, 0.0, v_l, 0.0)
            out.ttc_accelerated_s[i] = time_to_collision(gap, v, min(a, 0.0), v_l, a_l)
            out.reminder_m[i], out.danger_m[i] = reminder, danger
            # Whatever the model and the own brake: a gap that the closing speed and the leader's braking use
            # up in so short a time is worth a reminder.
            ahead = max(closing, 0.0) * c.floor_ttc_s
            worse = 0.5 * max(-a_l, 0.0) * min(c.floor_ttc_s, v_l / max(-a_l, 1e-9)) ** 2
            reminder = max(reminder, ahead + worse if closing > 0.0 else 0.0)
            comes = closing >= c.least_closing_mps or a_l < 0.0
            # A track that coasts keeps a level, but begins none.
            more = 1 if tracks.detected[t] else 0
            if comes and gap <= reminder:
                hits = state.hits[i] + more
            if comes and gap <= danger:
                hits_danger = state.danger_hits[i] + more
            wanted = 2 if hits_danger >= c.confirm_steps else (1 if hits >= c.confirm_steps else 0)
            if closing > 0.0 or a_l < 0.0:
                hold = (
                    2
                    if gap <= danger * (1.0 + c.relief)
                    else (1 if gap <= reminder * (1.0 + c.relief) else 0)
                )
            # Braking, and enough of it: if both go on like this it does not come to a collision.
            suppressed = a <= c.brakes_mps2 and out.ttc_accelerated_s[i] == math.inf
            if suppressed:
                wanted, hold = min(wanted, 1), min(hold, 1)
        if level == 2 and hold < 2 and (suppressed or since_danger >= c.least_danger_s - 1e-9):
            level = 1
        if level == 1 and hold < 1 and since >= c.least_reminder_s - 1e-9:
            level = 0
        started = 0
        if wanted > level:
            if level == 0:
                since = 0.0
            if wanted == 2:
                since_danger = 0.0
            level = started = wanted
        if not fast:
            level = started = 0
        code = INACTIVE if not fast else (READY, REMINDER, DANGER)[level]
        if fast and suppressed and (hits > 0 or level > 0):
            code = SUPPRESSED
        new.fast[i], new.level[i], new.since_s[i], new.danger_s[i] = fast, level, since, since_danger
        new.hits[i], new.danger_hits[i] = min(hits, 1000), min(hits_danger, 1000)
        out.code[i], out.level[i], out.started[i] = code, level, started
        out.lamp_reminder[i], out.lamp_danger[i] = level >= 1, level == 2
        out.buzzer[i] = ALARM if level == 2 else (CHIME if started == 1 and not suppressed else SILENT)
        out.shown_distance_m[i] = np.floor(out.gap_m[i] + 0.5)  # NaN stays NaN
        out.shown_relative_mps[i] = np.floor(out.relative_mps[i] + 0.5)


@kernel
def warn(state, tracks, motion, speed, acceleration, yaw_rate, path, c, new, out, inside, offset):  # type: ignore[no-untyped-def]
    """`in_path`, then `step`: of n vehicles with tracks (Targets), by PathNumbers and CollisionNumbers."""
    sight_shares(tracks, state.watched, state.sight_share, path.sight_memory_steps, new.sight_share)
    in_path(tracks, motion, speed, yaw_rate, path, state, new, out.nearest, inside, offset)
    for i in range(speed.size):
        t = out.nearest[i]
        if t != NONE and not tracks.standing[t] and _SEEN_FROM_M <= tracks.x_m[t] <= path.sight_m:
            new.watched[i] = tracks.track_id[t]
    step(state, tracks, inside, speed, acceleration, c, new, out)
