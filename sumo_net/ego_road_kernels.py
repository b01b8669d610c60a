"""Kernels that relate the ego's road frame to the RoadTable: path changes, inputs of a step, world pose.

`motion`, `mind`, `traits`, `drive` as in `sumo_net.ego` and `sumo_net.driver`; `table` a RoadTable.
"""

import math

import numpy as np

from sumo_net.compile import kernel
from sumo_net.driver_kernels import at_speed, reference, restart, shift_line
from sumo_net.ego_kernels import advance, forward_speed
from sumo_net.frames import wrap_angle
from sumo_net.road_kernels import containing_lanes, pose_at, project, segment_at, station_of
from sumo_net.road_table import OWN_RIGHT
from sumo_net.step import STEP_S

LANE_CHANGE_M = 1.5  # a path this far beside the last one means that SUMO has changed lanes
JUMP_M = 5.0  # a vehicle this far from its expected position has been moved: it starts anew
SIGHT_S = 3.0  # how far ahead the road must be calm for an episode to begin
ODD_WAY_M = 0.5  # a step whose displacement differs this much from speed times time was not driven
CLOSE_UP_S = 3.0  # time constant with which a lead or lag to SUMO's position decays
OUTER_MOST = 1.2  # largest ground speed over SUMO's on the outer side of a turn,
BEHIND_M = (3.0, 4.0)  # unless the vehicle has fallen behind by this much
_MOST_HEADING_RAD = 1.2


@kernel
def stretch_of(table, path):  # type: ignore[no-untyped-def]
    """Metres along the path per metre of SUMO's lane position; 1 on lanes too short to tell."""
    if table.own_length_m[path] < 5.0:
        return 1.0
    stretch = (table.own_end_m[path] - table.own_start_m[path]) / table.own_length_m[path]
    return min(max(stretch, 0.8), 1.25)


@kernel
def settle(motion, mind, traits, i, table, station, along, c, p):  # type: ignore[no-untyped-def]
    """Start vehicle i on its driver's line, in a steady turn of the path's curvature."""
    _, _, _, curvature = pose_at(table, motion.path[i], station)
    v = max(along, 0.1)
    if v * v * abs(curvature) > c.acceleration_most:
        curvature = math.copysign(c.acceleration_most / (v * v), curvature)
    yaw_rate = curvature * v
    # steady state of the corrected eq. (11): the rear tyres' force balances m l_f γ v / L
    v_y = p.l_r * yaw_rate - p.m * p.l_f * yaw_rate * v * v / (p.k_r * (p.l_f + p.l_r))
    motion.station_m[i], motion.along_mps[i] = station, along
    motion.offset_m[i] = traits.offset_m[i]
    motion.lateral_speed_mps[i], motion.yaw_rate_rps[i] = v_y, yaw_rate
    motion.heading_rad[i] = -math.atan2(v_y, v)
    steer = c.wheelbase * curvature * (1.0 + c.understeer * v * v)
    motion.steer_rad[i] = min(max(steer, -c.steer_most_rad), c.steer_most_rad)
    restart(mind, traits, i)


@kernel
def onto_paths(motion, mind, traits, table, changed, new_path, lane_position, speed, bumper, c, p):  # type: ignore[no-untyped-def]
    """Carry the world pose of the `changed` vehicles over to their new paths; new vehicles start there."""
    for j in range(len(changed)):
        i = changed[j]
        old, path = motion.path[i], new_path[i]
        along = stretch_of(table, path) * speed[i]
        # where SUMO had the vehicle before this step, as seen on the new path
        before = station_of(table, path, lane_position[i]) - bumper - STEP_S * along
        motion.path[i] = path
        if old < 0:
            settle(motion, mind, traits, i, table, before, along, c, p)
            continue
        if old == path:
            continue
        x, y, heading, curvature = pose_at(table, old, motion.station_m[i])
        d = motion.offset_m[i]
        x, y = x - d * math.sin(heading), y + d * math.cos(heading)
        heading += motion.heading_rad[i]
        s, d_new = project(table, path, x, y, before)
        _, _, path_heading, new_curvature = pose_at(table, path, s)
        e = float(wrap_angle(heading - path_heading))
        if not (abs(s - before) < JUMP_M and abs(d_new) < 3.0 * JUMP_M and abs(e) < _MOST_HEADING_RAD):
            settle(motion, mind, traits, i, table, before, along, c, p)
            continue
        motion.station_m[i], motion.offset_m[i], motion.heading_rad[i] = s, d_new, e
        # the speed over ground stays the same: ds/dt is smaller on an inner path
        motion.along_mps[i] *= (1.0 - d * curvature) / max(1.0 - d_new * new_curvature, 0.1)
        shift_line(mind, traits, i, d_new - d, abs(d_new - d) > LANE_CHANGE_M)


@kernel
def outer_share(curvature, offset, behind):  # type: ignore[no-untyped-def]
    """Factor on SUMO's displacement for a vehicle `offset` left of the path and `behind` SUMO's position.

    A vehicle that changes lanes shortly before a sharp turn drives much further than SUMO's along the lane.
    """
    ground = 1.0 - offset * curvature
    if ground <= OUTER_MOST:
        return 1.0
    patience = min(max((BEHIND_M[1] - behind) / (BEHIND_M[1] - BEHIND_M[0]), 0.0), 1.0)
    return 1.0 - patience * (1.0 - OUTER_MOST / ground)


@kernel
def drive_over(motion, mind, traits, drive, table, lane_position, speed, bumper, c, p):  # type: ignore[no-untyped-def]
    """Fill `drive` for the step to SUMO's new positions and move the stations there."""
    fade = STEP_S / CLOSE_UP_S
    for i in range(len(lane_position)):
        path = motion.path[i]
        along = stretch_of(table, path) * speed[i]
        place = station_of(table, path, lane_position[i]) - bumper
        # The vehicle moves as far as SUMO's does on its lane (Euler or ballistic), and closes up on SUMO's
        # position slowly: where lanes join or change, SUMO's lengths and the path's differ by up to a metre,
        # too much for one step. There, and where SUMO moves it, displacement is speed times time.
        way = place + bumper - station_of(table, path, motion.lane_position_m[i])
        if not abs(way - STEP_S * along) < ODD_WAY_M:
            way = STEP_S * along
        motion.lane_position_m[i] = lane_position[i]
        _, _, _, curvature = pose_at(table, path, motion.station_m[i])
        slowed = outer_share(curvature, motion.offset_m[i], place - motion.station_m[i])
        way *= slowed
        along *= slowed
        lead = motion.station_m[i] + way - place
        line, _, _ = reference(mind, traits, i)
        if not (
            abs(lead) < JUMP_M
            and abs(motion.offset_m[i] - line) < 2.0 * JUMP_M
            and abs(motion.heading_rad[i]) < _MOST_HEADING_RAD
        ):
            settle(motion, mind, traits, i, table, place - way, along, c, p)
            lead = 0.0
        lead *= 1.0 - fade * min(1.0, along / c.slow_mps)
        station = max(place + lead, motion.station_m[i])
        before, after = motion.station_m[i], station
        preview = at_speed(c.preview_s, along)
        _, _, _, drive.curvature_before_1pm[i] = pose_at(table, path, before)
        _, _, _, drive.curvature_after_1pm[i] = pose_at(table, path, after)
        _, _, _, drive.preview_before_1pm[i] = pose_at(table, path, before + preview * motion.along_mps[i])
        _, _, _, drive.preview_after_1pm[i] = pose_at(table, path, after + preview * along)
        _, _, _, drive.curvature_sight_1pm[i] = pose_at(table, path, after + SIGHT_S * along)
        g = segment_at(table, path, after)
        width = table.border_offset_m[g, OWN_RIGHT + 1] - table.border_offset_m[g, OWN_RIGHT]
        drive.half_lane_m[i] = 0.5 * width if math.isfinite(width) else 1.6
        drive.distance_m[i] = after - before
        drive.speed_before_mps[i], drive.speed_after_mps[i] = motion.along_mps[i], along
        motion.station_m[i] = station


@kernel
def drive_on(motion, mind, traits, drive, table, lane_position, speed, bumper, c, p):  # type: ignore[no-untyped-def]
    """Move the vehicles over the step to SUMO's new positions, in place; `drive` is work space."""
    drive_over(motion, mind, traits, drive, table, lane_position, speed, bumper, c, p)
    advance(motion, mind, traits, drive, c, p)


@kernel
def place(motion, table):  # type: ignore[no-untyped-def]
    """World x, y, heading of the centre of gravity, the path's curvature and the forward speed, each (n,)."""
    n = len(motion.station_m)
    x, y, heading, curvature, speed = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        px, py, along, curvature[i] = pose_at(table, motion.path[i], motion.station_m[i])
        d, e = motion.offset_m[i], motion.heading_rad[i]
        x[i], y[i] = px - d * math.sin(along), py + d * math.cos(along)
        heading[i] = float(wrap_angle(along + e))
        speed[i] = forward_speed(motion.along_mps[i], motion.lateral_speed_mps[i], d, e, curvature[i])
    return x, y, heading, curvature, speed


@kernel
def front_laterals(motion, table, bumper):  # type: ignore[no-untyped-def]
    """Offset (n,) of the front bumper's centre from the path abreast of it."""
    out = np.empty(len(motion.station_m))
    for i in range(len(out)):
        d, e = motion.offset_m[i], motion.heading_rad[i]
        _, _, _, curvature = pose_at(table, motion.path[i], motion.station_m[i])
        ahead = bumper * math.cos(e)
        # to second order in the bumper's distance b: the path curves by κ b² / 2 over it
        out[i] = d + bumper * math.sin(e) - 0.5 * curvature * ahead * ahead
    return out


@kernel
def stand(motion, table, bumper):  # type: ignore[no-untyped-def]
    """`place`, `containing_lanes` of the centres of gravity, and `front_laterals`."""
    lanes = containing_lanes(table, motion.path, motion.station_m, motion.offset_m)
    return place(motion, table), lanes, front_laterals(motion, table, bumper)
