"""Kernels of the ego's lateral motion in the road frame: driver, steering, 2-DOF model, path kinematics.

Road frame: d left of the path, e = heading minus the path's heading; ḋ = v sin e + v_y cos e, ė = γ − κ ṡ.
"""

import math
from typing import NamedTuple

from sumo_net.compile import kernel
from sumo_net.driver_kernels import at_speed, attend, correction, profile, tightness, unrest, veer
from sumo_net.step import STEP_S
from sumo_net.vehicle import derivatives

SUBSTEPS = 10
KINEMATIC_BELOW_MPS = 2.0
DYNAMIC_ABOVE_MPS = 4.0
# Where `guidance` sets in and is full: lateral acceleration and share of full lock that the curve needs, yaw
# rate minus the curve's, heading relative to the path.
GUIDED_MPS2 = (6.0, 10.0)
GUIDED_LOCK = (0.8, 1.0)
GUIDED_RPS = (0.4, 0.8)
GUIDED_RAD = (0.5, 0.8)
LED_LOCK = (1.0, 2.0)  # share of full lock where the vehicle begins to be put, and is put, on the path
_GUIDE_PER_STEP = 0.4
_RELAXATION_1PS = 25.0  # towards rolling without slip, similar to the tyres' own rate at 4 m/s
_F3, _F4, _F5, _F6, _F7, _F8, _F9, _F10 = (1.0 / math.factorial(k) for k in range(3, 11))


@kernel
def lateral_rates(v_y, yaw_rate, steer, v, p):  # type: ignore[no-untyped-def]
    """(v̇_y, γ̇) at any speed: corrected eq. (11) above 4 m/s, rolling without slip below 2 m/s.

    In between they are blended smoothly; at v = 0 both states decay to zero.
    """
    if v >= DYNAMIC_ABOVE_MPS:
        return derivatives(v_y, yaw_rate, steer, v, p)
    rolling = max(v, 0.0) * math.tan(steer) / (p.l_f + p.l_r)
    slow_v_y = _RELAXATION_1PS * (p.l_r * rolling - v_y)
    slow_yaw = _RELAXATION_1PS * (rolling - yaw_rate)
    if v <= KINEMATIC_BELOW_MPS:
        return slow_v_y, slow_yaw
    u = (v - KINEMATIC_BELOW_MPS) / (DYNAMIC_ABOVE_MPS - KINEMATIC_BELOW_MPS)
    w = u * u * (3.0 - 2.0 * u)
    fast_v_y, fast_yaw = derivatives(v_y, yaw_rate, steer, v, p)
    return w * fast_v_y + (1.0 - w) * slow_v_y, w * fast_yaw + (1.0 - w) * slow_yaw


@kernel
def sine_cosine(angle):  # type: ignore[no-untyped-def]
    """(sin, cos) by series, with an error below 3e-7, of an angle clipped to ±1.2 rad."""
    a = min(max(angle, -1.2), 1.2)
    q = a * a
    sine = a * (1.0 - q * (_F3 - q * (_F5 - q * (_F7 - q * _F9))))
    cosine = 1.0 - q * (0.5 - q * (_F4 - q * (_F6 - q * (_F8 - q * _F10))))
    return sine, cosine


@kernel
def forward_speed(along, v_y, d, e, curvature):  # type: ignore[no-untyped-def]
    """Speed of the centre of gravity along the vehicle's x axis; `along` = ṡ."""
    sine, cosine = sine_cosine(e)
    return (along * max(1.0 - d * curvature, 0.1) + v_y * sine) / cosine


@kernel
def rates(d, e, v_y, yaw_rate, steer, along, curvature, p):  # type: ignore[no-untyped-def]
    """(ḋ, ė, v̇_y, γ̇); `along` = ṡ."""
    sine, cosine = sine_cosine(e)
    v = (along * max(1.0 - d * curvature, 0.1) + v_y * sine) / cosine
    dv_y, dyaw = lateral_rates(v_y, yaw_rate, steer, v, p)
    return v * sine + v_y * cosine, yaw_rate - curvature * along, dv_y, dyaw


@kernel
def runge_kutta(x, steer, steer_end, along, along_end, curvature, curvature_end, h, p):  # type: ignore[no-untyped-def]
    """One classical step of x = (d, e, v_y, γ), the inputs linear over it."""
    steer_mid, along_mid = 0.5 * (steer + steer_end), 0.5 * (along + along_end)
    curvature_mid = 0.5 * (curvature + curvature_end)
    a = rates(x[0], x[1], x[2], x[3], steer, along, curvature, p)
    g = 0.5 * h
    b = rates(
        x[0] + g * a[0], x[1] + g * a[1], x[2] + g * a[2], x[3] + g * a[3],
        steer_mid, along_mid, curvature_mid, p,
    )  # fmt: skip
    k = rates(
        x[0] + g * b[0], x[1] + g * b[1], x[2] + g * b[2], x[3] + g * b[3],
        steer_mid, along_mid, curvature_mid, p,
    )  # fmt: skip
    q = rates(
        x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3],
        steer_end, along_end, curvature_end, p,
    )  # fmt: skip
    w = h / 6.0
    return (
        x[0] + w * (a[0] + 2.0 * b[0] + 2.0 * k[0] + q[0]),
        x[1] + w * (a[1] + 2.0 * b[1] + 2.0 * k[1] + q[1]),
        x[2] + w * (a[2] + 2.0 * b[2] + 2.0 * k[2] + q[2]),
        x[3] + w * (a[3] + 2.0 * b[3] + 2.0 * k[3] + q[3]),
    )


@kernel
def guidance(bend, v, e, odd_yaw_rate, c):  # type: ignore[no-untyped-def]
    """Share for `guided` in a step: 0 where tyres, lock and driver can follow a road of curvature `bend` ≥ 0.

    `odd_yaw_rate`, the vehicle's minus the curve's, counts too: after a turn with guidance, wheels that are
    still turned would take the vehicle off the road.
    """
    lock = bend * c.wheelbase * (1.0 + c.understeer * v * v) / c.steer_most_rad
    beyond = max(_ramp(bend * v * v, GUIDED_MPS2), _ramp(lock, GUIDED_LOCK))
    beyond = max(beyond, _ramp(abs(odd_yaw_rate), GUIDED_RPS), _ramp(abs(e), GUIDED_RAD))
    return max(_GUIDE_PER_STEP * beyond, _ramp(bend * c.wheelbase / c.steer_most_rad, LED_LOCK))


@kernel
def _ramp(value, ends):  # type: ignore[no-untyped-def]
    return min(max((value - ends[0]) / (ends[1] - ends[0]), 0.0), 1.0)


@kernel
def guided(x, line, curvature, along, share, p):  # type: ignore[no-untyped-def]
    """Move x = (d, e, v_y, γ) by `share` towards rolling along the path on the driver's line.

    SUMO takes city turns and kinks of its lanes at speeds beyond the tyres' limits, and turns on the spot. A
    physical vehicle would leave the road there; this one is guided along it, and its motion there is not
    physical.
    """
    yaw_rate = curvature * along
    v_y = p.l_r * yaw_rate
    slip = math.atan2(v_y, max(along, 1.0))
    return (
        x[0] + share * (line - x[0]),
        x[1] + share * (-slip - x[1]),
        x[2] + share * (v_y - x[2]),
        x[3] + share * (yaw_rate - x[3]),
    )


class Course(NamedTuple):
    """The line that a driver follows over a step: that of a drift if `veering`, else of a lane change."""

    veering: bool
    veer_from_m: float
    veer_rate_mps: float
    veer_ramp_s: float
    from_m: float
    from_rate_mps: float
    from_rate2_mps2: float
    target_m: float
    duration_s: float
    preview_s: float  # the acceleration counts this much earlier


@kernel
def _course(mind, traits, i, preview):  # type: ignore[no-untyped-def]
    return Course(
        mind.veer_left_s[i] > 0.0,
        mind.veer_from_m[i],
        mind.veer_rate_mps[i],
        mind.veer_ramp_s[i],
        mind.change_from_m[i],
        mind.change_rate_mps[i],
        mind.change_rate2_mps2[i],
        traits.offset_m[i],
        mind.change_duration_s[i],
        preview,
    )


@kernel
def _changing(course, elapsed):  # type: ignore[no-untyped-def]
    """Position, velocity, acceleration of a Course's lane change."""
    return profile(
        course.from_m,
        course.from_rate_mps,
        course.from_rate2_mps2,
        course.target_m,
        elapsed,
        course.duration_s,
    )


@kernel
def _line(course, elapsed, veer_elapsed):  # type: ignore[no-untyped-def]
    """Position, velocity, and previewed acceleration of a Course."""
    ahead = course.preview_s
    if course.veering:
        begin, rate, ramp = course.veer_from_m, course.veer_rate_mps, course.veer_ramp_s
        line, line_rate, _ = veer(begin, rate, ramp, veer_elapsed)
        _, _, line_rate2 = veer(begin, rate, ramp, veer_elapsed + ahead)
        return line, line_rate, line_rate2
    if elapsed < course.duration_s:
        line, line_rate, _ = _changing(course, elapsed)
        _, _, line_rate2 = _changing(course, elapsed + ahead)
        return line, line_rate, line_rate2
    return course.target_m, 0.0, 0.0


@kernel
def _demand(x, v, line, disturbance, look, tight, c):  # type: ignore[no-untyped-def]
    """Curvature in 1/m that the driver steers at speed v: `look`, the road's, and back to the line.

    line: position, velocity, acceleration; disturbance: m/s².
    """
    # Below `slow`, control goes by distance, not time: nothing is singular at standstill.
    v_scale = max(v, c.slow_mps)
    per_square = 1.0 / (v_scale * v_scale)
    harder = 1.0 + c.tight_gain * tight
    sine, cosine = sine_cosine(x[1])
    drift = v_scale * (sine + x[2] * cosine / max(v, 1.0))
    back, limit = correction(
        x[0] - line[0],
        drift - line[1],
        c.bandwidth_rps * harder,
        c.damping,
        c.correction_most_mps2 * harder,
        c.acceleration_most,
    )
    back += line[2] + disturbance
    back = min(max(back, -limit), limit)
    # Friction limits the demand, unless SUMO itself drives a turn faster than that.
    most = c.acceleration_most * per_square
    if tight > 0.0:
        most = max(most, limit * per_square + abs(look))
    return min(max(look + back * per_square, -most), most)


@kernel
def _attention(i, x, steer, tight, mind, traits, drive, c, p):  # type: ignore[no-untyped-def]
    """Let the driver's attention, and episodes of inattention, go on; returns the new slow noise."""
    k, square = drive.curvature_after_1pm[i], drive.speed_after_mps[i] * drive.speed_after_mps[i]
    calm = (
        abs(k) * square < c.calm_curve_mps2
        and abs(drive.curvature_sight_1pm[i] - k) * square < c.calm_change_mps2
    )
    if tight > 0.2:  # R < 78 m: no inattention in turns
        calm = False
        mind.episode_left_s[i] = min(mind.episode_left_s[i], STEP_S)
    front = x[0] + p.l_f * math.sin(x[1])
    return attend(mind, traits, i, x[0], front, drive.half_lane_m[i], steer, calm, drive.alerted[i], c)


@kernel
def advance(motion, mind, traits, drive, c, p):  # type: ignore[no-untyped-def]
    """One step of 0.1 s for n vehicles, in place in `motion` (Motion) and `mind` (Mind).

    `drive` (Drive): inputs from road and SUMO; c: DriverNumbers; p: Model.
    """
    h = STEP_S / SUBSTEPS
    steer_share = 1.0 - math.exp(-h / c.steer_lag_s)
    steer_move_most = c.steer_rate_most_rps * h
    for i in range(len(motion.offset_m)):
        x = (motion.offset_m[i], motion.heading_rad[i], motion.lateral_speed_mps[i], motion.yaw_rate_rps[i])
        steer = motion.steer_rad[i] - c.jitter_gain * (mind.unrest[i] - mind.calm[i])  # without jitter
        v_old, v_new = drive.speed_before_mps[i], drive.speed_after_mps[i]
        k_old, k_new = drive.curvature_before_1pm[i], drive.curvature_after_1pm[i]
        look_old, look_new = drive.preview_before_1pm[i], drive.preview_after_1pm[i]
        v_mean = 0.5 * (v_old + v_new)
        # SUMO's displacement is not mean speed times step (Euler); this keeps both exact
        stretch = drive.distance_m[i] / (STEP_S * v_mean) if v_mean > 0.01 else 1.0

        tight = tightness(max(abs(k_old), abs(k_new), abs(look_new)))
        noise_new = _attention(i, x, steer, tight, mind, traits, drive, c, p)
        noise_old = mind.noise[i]
        mind.noise[i] = noise_new
        frozen = mind.episode_left_s[i] > 0.0
        jitter_old = jitter_end = c.jitter_gain * (mind.unrest[i] - mind.calm[i])
        jitter_change = c.jitter_gain * unrest(mind, traits, i, c.jitter_keep) - jitter_old
        # The slow disturbance makes up what the jitter leaves of the driver's SDLP
        slow_sd = math.sqrt(max(traits.sd_m[i] ** 2 - at_speed(c.jitter_lateral, v_mean) ** 2, 0.0))
        scale = slow_sd * at_speed(c.noise_scale, v_mean)  # m/s² of disturbance
        course = _course(mind, traits, i, at_speed(c.preview_s, v_mean))
        elapsed, veer_elapsed = mind.change_elapsed_s[i], mind.veer_elapsed_s[i]

        for j in range(SUBSTEPS):
            begin, end = j / SUBSTEPS, (j + 1) / SUBSTEPS
            v, v_end = v_old + begin * (v_new - v_old), v_old + end * (v_new - v_old)
            k, k_end = k_old + begin * (k_new - k_old), k_old + end * (k_new - k_old)
            steer_per_curvature = c.wheelbase * (1.0 + c.understeer * v * v)
            if frozen:
                v_scale = max(v, c.slow_mps)
                drift = steer_per_curvature * mind.drift_mps2[i]
                asked = mind.held_steer_rad[i] + drift * (1.0 / (v_scale * v_scale))
            else:
                line = _line(course, elapsed, veer_elapsed)
                disturbance = scale * (noise_old + begin * (noise_new - noise_old))
                look = look_old + begin * (look_new - look_old)
                asked = steer_per_curvature * _demand(x, v, line, disturbance, look, tight, c)
            asked = min(max(asked, -c.steer_most_rad), c.steer_most_rad)
            move = min(max(steer_share * (asked - steer), -steer_move_most), steer_move_most)
            jitter, jitter_end = jitter_end, jitter_old + end * jitter_change
            x = runge_kutta(
                x, steer + jitter, steer + move + jitter_end, stretch * v, stretch * v_end, k, k_end, h, p
            )
            steer += move
            elapsed += h * min(1.0, v * (1.0 / c.slow_mps))
            veer_elapsed += h

        mind.change_elapsed_s[i] = elapsed
        mind.veer_elapsed_s[i] = veer_elapsed
        bend = max(abs(k_old), abs(k_new), abs(look_old), abs(look_new))
        guide = guidance(bend, v_mean, x[1], x[3] - k_new * stretch * v_new, c)
        if guide > 0.0:
            x = guided(x, _changing(course, elapsed)[0], k_new, stretch * v_new, guide, p)
            steer += guide * (min(max(c.wheelbase * k_new, -c.steer_most_rad), c.steer_most_rad) - steer)
        motion.offset_m[i], motion.heading_rad[i] = x[0], x[1]
        motion.lateral_speed_mps[i], motion.yaw_rate_rps[i] = x[2], x[3]
        motion.steer_rad[i] = steer + jitter_end
        motion.along_mps[i] = v_new
