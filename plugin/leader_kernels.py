"""Kernels of the true leaders: along SUMO's lanes, and by where bodies are on the road."""

import math

import numpy as np

from sumo_net.compile import kernel
from sumo_net.road_kernels import pose_at, project

_HALF_BODY_M = 0.9  # of an equipped vehicle
_STILL_MPS = 1e-3  # SUMO's standing queues still close by 1e-80 m/s


@kernel
def by_lane(lane, position, lanes):  # type: ignore[no-untyped-def]
    """The order (N,) of vehicles by lane (N,), -1 first, and position along it; where each lane begins in it.

    The beginnings are (lanes + 1,). The sort is stable.
    """
    begin = np.zeros(lanes + 2, np.int64)  # of lane -1, 0, 1, ...
    for k in range(len(lane)):
        begin[lane[k] + 2] += 1
    for one in range(lanes + 1):
        begin[one + 1] += begin[one]
    order, end = np.empty(len(lane), np.int64), begin[: lanes + 1].copy()
    for k in range(len(lane)):
        place = end[lane[k] + 1]
        end[lane[k] + 1] += 1
        while place > begin[lane[k] + 1] and position[order[place - 1]] > position[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k
    return order, begin[1:]


@kernel
def time_to_collision(gap, closing):  # type: ignore[no-untyped-def]
    """Gap over closing speed; infinite where the gap does not close."""
    return max(gap, 0.0) / closing if closing > _STILL_MPS else math.inf


@kernel
def lane_leaders(rows, snapshot, count, chain, lanes, ahead, reach, out):  # type: ignore[no-untyped-def]
    """The next vehicle ahead of each of the snapshot's `rows` (n,) on its lane or those that follow.

    count : number of lanes. chain (n,) : row in `lanes` (C, L) int32, lane numbers in driving order from the
    own one on, padded with -1, and in `ahead` (C, L), m from the own lane's beginning to theirs. Fills `out`
    (Leaders), which must be empty before.
    """
    order, first = by_lane(snapshot.lane, snapshot.lane_position_m, count)
    place = np.empty(len(order), np.int64)
    for k in range(len(order)):
        place[order[k]] = k
    for i in range(len(rows)):
        me = rows[i]
        if snapshot.lane[me] < 0 or chain[i] < 0:
            continue
        for j in range(lanes.shape[1]):
            lane = lanes[chain[i], j]
            if lane < 0 or ahead[chain[i], j] - snapshot.lane_position_m[me] > reach:
                break
            if lane + 1 >= len(first):
                continue
            at = place[me] + 1 if j == 0 else first[lane]
            if at >= first[lane + 1]:
                continue
            other = order[at]
            gap = ahead[chain[i], j] + snapshot.lane_position_m[other] - snapshot.length_m[other]
            gap -= snapshot.lane_position_m[me]
            if gap <= reach:
                closing = snapshot.speed_mps[me] - snapshot.speed_mps[other]
                out.handle[i] = snapshot.handle[other]
                out.gap_m[i], out.closing_mps[i] = gap, closing
                out.ttc_s[i] = time_to_collision(gap, closing)
            break


@kernel
def in_view(handle, share, target, least):  # type: ignore[no-untyped-def]
    """Whether `target` (n,), -1 for none, is among `handle` (n, M), its share (n, M) at least `least`."""
    out = np.zeros(len(target), np.bool_)
    for i in range(len(target)):
        for m in range(handle.shape[1]):
            if target[i] != -1 and handle[i, m] == target[i] and share[i, m] >= least:
                out[i] = True
    return out


@kernel
def _overlap(objects, i, a, b):  # type: ignore[no-untyped-def]
    """Whether the footprints of the Objects a and b of vehicle i overlap: no side of either parts them."""
    dx = objects.forward_m[i, b] - objects.forward_m[i, a]
    dy = objects.left_m[i, b] - objects.left_m[i, a]
    turn = objects.heading_rad[i, b] - objects.heading_rad[i, a]
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    for one, other in ((a, b), (b, a)):
        c, s = math.cos(objects.heading_rad[i, one]), math.sin(objects.heading_rad[i, one])
        length, width = 0.5 * objects.length_m[i, other], 0.5 * objects.width_m[i, other]
        along, across = cos * length + sin * width, sin * length + cos * width
        if abs(c * dx + s * dy) >= 0.5 * objects.length_m[i, one] + along:
            return False
        if abs(c * dy - s * dx) >= 0.5 * objects.width_m[i, one] + across:
            return False
    return True


@kernel
def overlapped(objects, target):  # type: ignore[no-untyped-def]
    """Whether another vehicle's body overlaps the one of `target` (n,), -1 for none, among Objects (n, M)."""
    out = np.zeros(len(target), np.bool_)
    for i in range(len(target)):
        for m in range(objects.handle.shape[1]):
            if target[i] == -1 or objects.handle[i, m] != target[i]:
                continue
            for k in range(objects.handle.shape[1]):
                if k != m and objects.handle[i, k] >= 0 and _overlap(objects, i, m, k):
                    out[i] = True
    return out


@kernel
def _approached(leader, i, speed, closing, close):  # type: ignore[no-untyped-def]
    return leader.closing_mps[i] > closing or leader.gap_m[i] < close * speed[i]


@kernel
def approaches(leader, in_path, target, speed, closing, close, ttc):  # type: ignore[no-untyped-def]
    """Which vehicles (A,) approach any of three Leaders; which (B,) are in conflict.

    Approaching: closing at more than `closing` m/s, or less than `close` s behind at the own speed (n,). In
    conflict: a time to collision with `leader` under `ttc` s.
    """
    n = len(speed)
    approached, near, a, b = np.empty(n, np.int64), np.empty(n, np.int64), 0, 0
    for i in range(n):
        approaching = _approached(leader, i, speed, closing, close)
        approaching = approaching or _approached(in_path, i, speed, closing, close)
        if approaching or _approached(target, i, speed, closing, close):
            approached[a] = i
            a += 1
        if leader.ttc_s[i] < ttc:
            near[b] = i
            b += 1
    return approached[:a], near[:b]


@kernel
def _far_aside(table, path, x, y, station, centre, within):  # type: ignore[no-untyped-def]
    """Whether a point is surely more than `within` beside the lane's centre, without its projection.

    Seen from the path at `station`, `along` m off the point's projection: a bend of 50 m radius turns by
    along / 50 up to there, which shifts the point by along² / 100, under along / 4 + 2 while along < 30 m.
    """
    px, py, heading, _ = pose_at(table, path, station)
    c, n = math.cos(heading), math.sin(heading)
    along, aside = c * (x - px) + n * (y - py), c * (y - py) - n * (x - px)
    return abs(along) < 30.0 and abs(aside - centre) > within + 2.0 + 0.25 * abs(along)


@kernel
def _place(truth, i, objects, m, table, bumper, overlap, entered):  # type: ignore[no-untyped-def]
    """Gap of body m along the path of vehicle i if it is in its way, else NaN.

    It must reach by `overlap` m into the lane that contains the vehicle or the one `entered` m beside it, or
    lie straight ahead of the own body within two seconds: a vehicle that leaves its lane may hit what stands
    beside the road.
    """
    forward, left = objects.forward_m[i, m], objects.left_m[i, m]
    cos, sin = math.cos(truth.heading_rad[i]), math.sin(truth.heading_rad[i])
    x, y = truth.x_m[i] + cos * forward - sin * left, truth.y_m[i] + sin * forward + cos * left
    centre = truth.path_offset_m[i] - truth.lane_offset_m[i] + 0.5 * entered
    half = 0.5 * objects.width_m[i, m]
    straight = abs(left) <= half + _HALF_BODY_M and forward <= 2.0 * truth.speed_mps[i]
    within = 0.5 * (truth.lane_width_m[i] + abs(entered)) + half - overlap
    guess = truth.station_m[i] + forward
    if not straight and _far_aside(table, truth.path[i], x, y, guess, centre, within):
        return math.nan
    s, d = project(table, truth.path[i], x, y, guess)
    if not (straight or abs(d - centre) <= within):
        return math.nan
    return s - truth.station_m[i] - bumper - 0.5 * objects.length_m[i, m]


@kernel
def _lead(truth, i, objects, m, gap, out):  # type: ignore[no-untyped-def]
    """Body m, `gap` m ahead along the path, as the leader of vehicle i into `out` (Leaders)."""
    closing = truth.speed_mps[i] - objects.speed_mps[i, m] * math.cos(objects.heading_rad[i, m])
    out.handle[i], out.gap_m[i], out.closing_mps[i] = objects.handle[i, m], gap, closing
    out.ttc_s[i] = time_to_collision(gap, closing)


@kernel
def path_leaders(truth, objects, table, bumper, overlap, out):  # type: ignore[no-untyped-def]
    """The nearest body in the way (`_place`) of each vehicle in its lane, whatever SUMO's lane is.

    Gap and closing speed are along the path. Fills `out` (Leaders), which must be empty before.
    """
    n, M = objects.forward_m.shape
    for i in range(n):
        for m in range(M):
            forward = objects.forward_m[i, m]
            if objects.handle[i, m] == -1 or forward < 0.0:
                continue
            if forward - bumper - 0.5 * objects.length_m[i, m] >= out.gap_m[i]:
                continue  # the path is no shorter than the straight line; NaN (no leader) is not greater
            gap = _place(truth, i, objects, m, table, bumper, overlap, 0.0)
            if gap < out.gap_m[i] or (out.handle[i] == -1 and not math.isnan(gap)):
                _lead(truth, i, objects, m, gap, out)


@kernel
def warned_of(truth, objects, table, target, bumper, overlap, entering, out):  # type: ignore[no-untyped-def]
    """The bodies `target` (n,), -1 for none, where they are in the way of their vehicles (`_place`).

    The lane that a vehicle is in after `entering` s at its present lateral speed counts, too. Fills `out`
    (Leaders), which must be empty before.
    """
    for i in range(len(target)):
        if target[i] == -1:
            continue
        sine, cosine = math.sin(truth.lane_heading_rad[i]), math.cos(truth.lane_heading_rad[i])
        across = truth.speed_mps[i] * sine + truth.lateral_speed_mps[i] * cosine
        aside, width = truth.lane_offset_m[i] + entering * across, truth.lane_width_m[i]
        entered = math.copysign(width, aside) if abs(aside) > 0.5 * width else 0.0
        for m in range(objects.handle.shape[1]):
            if objects.handle[i, m] == target[i] and objects.forward_m[i, m] >= 0.0:
                gap = _place(truth, i, objects, m, table, bumper, overlap, entered)
                if not math.isnan(gap):
                    _lead(truth, i, objects, m, gap, out)
