"""Kernels of the lateral driver: lane-change profile, episodes of inattention, and steering demand.

`mind`, `traits` and `c` are a Mind, Traits and DriverNumbers of `sumo_net.driver`; `i` is the vehicle. The
mind's arrays are written in place.
"""

import math

from sumo_net.compile import kernel
from sumo_net.randomness import normal, uniform
from sumo_net.step import STEP_S

LANE_KEEPING, DISTRACTION, MICROSLEEP, SIGNALLED_CHANGE, UNSIGNALLED_CHANGE = range(5)  # as in CAUSES
RECOVERY_S = 5.0  # how long an episode counts as the cause of what follows, at most,
RECOVERED_M = 0.3  # or until the vehicle is this near its line
TABLE_SPEED_STEP_MPS = 4.0
_UNREST_STREAM = 2**40  # first counter of the jitter, beyond all counters of the slow noise


@kernel
def profile(start, rate, rate2, target, elapsed, duration):  # type: ignore[no-untyped-def]
    """Position, velocity, acceleration of the quintic from (start, rate, rate2) to rest at `target`."""
    if elapsed >= duration:
        return target, 0.0, 0.0
    T, t = duration, max(elapsed, 0.0)
    h = target - start
    c3 = (20.0 * h - 12.0 * rate * T - 3.0 * rate2 * T * T) / (2.0 * T**3)
    c4 = (-30.0 * h + 16.0 * rate * T + 3.0 * rate2 * T * T) / (2.0 * T**4)
    c5 = (12.0 * h - 6.0 * rate * T - rate2 * T * T) / (2.0 * T**5)
    y = start + t * (rate + t * (0.5 * rate2 + t * (c3 + t * (c4 + t * c5))))
    dy = rate + t * (rate2 + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5)))
    ddy = rate2 + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))
    return y, dy, ddy


@kernel
def veer(start, rate, ramp, elapsed):  # type: ignore[no-untyped-def]
    """Position, velocity, acceleration of a line from `start` whose drift reaches `rate` after `ramp` s."""
    t = max(elapsed, 0.0)
    if t >= ramp:
        return start + rate * (t - 0.5 * ramp), rate, 0.0
    u = t / ramp
    return (
        start + rate * ramp * u**3 * (1.0 - 0.5 * u),
        rate * u * u * (3.0 - 2.0 * u),
        6.0 * rate * u * (1.0 - u) / ramp,
    )


@kernel
def reference(mind, traits, i):  # type: ignore[no-untyped-def]
    """The driver's desired line (or that of a scripted drift) now: position, velocity, acceleration."""
    if mind.veer_left_s[i] > 0.0:
        return veer(mind.veer_from_m[i], mind.veer_rate_mps[i], mind.veer_ramp_s[i], mind.veer_elapsed_s[i])
    return profile(
        mind.change_from_m[i],
        mind.change_rate_mps[i],
        mind.change_rate2_mps2[i],
        traits.offset_m[i],
        mind.change_elapsed_s[i],
        mind.change_duration_s[i],
    )


@kernel
def draw(mind, traits, i):  # type: ignore[no-untyped-def]
    """The vehicle's next uniform event draw."""
    mind.events[i] += 1
    return uniform(traits.event_key[i], mind.events[i])


@kernel
def draw_normal(mind, traits, i):  # type: ignore[no-untyped-def]
    """The vehicle's next standard normal event draw, by Box and Muller."""
    radius = math.sqrt(-2.0 * math.log(1.0 - draw(mind, traits, i)))
    return radius * math.cos(2.0 * math.pi * draw(mind, traits, i))


@kernel
def draw_waiting(mind, traits, i, rate):  # type: ignore[no-untyped-def]
    """Exponential waiting time in s of a Poisson process."""
    u = draw(mind, traits, i)
    return -math.log(1.0 - u) / rate if rate > 0.0 else math.inf


@kernel
def shift_line(mind, traits, i, shift, deliberate):  # type: ignore[no-untyped-def]
    """Continue the desired line on a new path, in which all offsets are larger by `shift` m.

    `deliberate`: SUMO has changed lanes. That ends any episode, draws whether the change is signalled and
    sets the cause; a change over a further lane continues the same manoeuvre. Otherwise only the line is
    carried over (two fits of a road differ by centimetres).
    """
    y, dy, ddy = reference(mind, traits, i)
    if mind.veer_left_s[i] > 0.0 and not deliberate:
        mind.veer_from_m[i] += shift
        return
    mind.veer_left_s[i] = 0.0
    mind.change_from_m[i] = y + shift
    mind.change_rate_mps[i] = dy
    mind.change_rate2_mps2[i] = ddy
    left = mind.change_duration_s[i] - mind.change_elapsed_s[i]
    goes_on = mind.cause[i] >= SIGNALLED_CHANGE and left > 0.0 and y * shift > 0.0
    mind.change_elapsed_s[i] = 0.0
    if not deliberate:
        mind.change_duration_s[i] = max(left, 2.0)
        return
    mind.change_duration_s[i] = traits.change_s[i]
    mind.episode_left_s[i] = 0.0
    mind.recovery_left_s[i] = 0.0
    if goes_on:
        return
    if draw(mind, traits, i) < traits.signal_probability[i]:
        mind.cause[i] = SIGNALLED_CHANGE
        mind.signal[i] = -1 if shift > 0.0 else 1
    else:
        mind.cause[i] = UNSIGNALLED_CHANGE
        mind.signal[i] = 0


@kernel
def lead_back(mind, traits, i):  # type: ignore[no-untyped-def]
    """End a scripted drift: the driver steers back to the own line, as smoothly as in a lane change."""
    y, dy, ddy = reference(mind, traits, i)
    mind.veer_left_s[i] = 0.0
    mind.change_from_m[i], mind.change_rate_mps[i], mind.change_rate2_mps2[i] = y, dy, ddy
    mind.change_elapsed_s[i] = 0.0
    mind.change_duration_s[i] = traits.change_s[i]
    mind.recovery_left_s[i] = RECOVERY_S


@kernel
def restart(mind, traits, i):  # type: ignore[no-untyped-def]
    """Reset the driver to the own line, attentive; waiting times and counters are kept."""
    mind.noise[i] = 0.0
    mind.unrest[i] = mind.calm[i] = 0.0
    mind.cause[i] = LANE_KEEPING
    mind.signal[i] = 0
    mind.episode_left_s[i] = 0.0
    mind.recovery_left_s[i] = 0.0
    mind.change_from_m[i] = traits.offset_m[i]
    mind.change_rate_mps[i] = 0.0
    mind.change_rate2_mps2[i] = 0.0
    mind.change_elapsed_s[i] = 1.0
    mind.change_duration_s[i] = 1.0
    mind.veer_left_s[i] = 0.0


@kernel
def attend(mind, traits, i, d, d_front, half_lane, steer, calm, alerted, c):  # type: ignore[no-untyped-def]
    """One step of the driver's attention: begin and end of episodes, end of a lane change, disturbance.

    d and d_front: offsets of centre of gravity and front axle; calm: the road allows an episode to begin.
    Returns the disturbance at the end of the step (standard normal).
    """
    if math.isnan(mind.until_glance_s[i]):
        mind.until_glance_s[i] = draw_waiting(mind, traits, i, c.glance_rate)
        rate = c.microsleep_rate if traits.sleepy[i] else 0.0
        mind.until_microsleep_s[i] = draw_waiting(mind, traits, i, rate)

    veering = mind.veer_left_s[i] > 0.0
    if veering:
        if alerted:
            mind.veer_left_s[i] = min(mind.veer_left_s[i], traits.reaction_s[i])
        mind.veer_left_s[i] -= STEP_S
        if mind.veer_left_s[i] <= 1e-9:
            mind.veer_left_s[i] = STEP_S  # so that `reference` still returns the drift's line
            lead_back(mind, traits, i)
            veering = False
    changing = mind.change_elapsed_s[i] < mind.change_duration_s[i]
    if mind.cause[i] >= SIGNALLED_CHANGE and not changing:
        mind.cause[i] = LANE_KEEPING
        mind.signal[i] = 0

    mind.until_glance_s[i] -= STEP_S
    mind.until_microsleep_s[i] -= STEP_S
    if mind.episode_left_s[i] > 0.0:
        beyond = abs(d_front) + traits.half_span_m[i] - half_lane
        if alerted:
            mind.episode_left_s[i] = min(mind.episode_left_s[i], traits.reaction_s[i])
        if beyond > c.wake_beyond_border_m:
            mind.episode_left_s[i] = min(mind.episode_left_s[i], c.startle_s)
        mind.episode_left_s[i] -= STEP_S
        if mind.episode_left_s[i] <= 0.0:
            mind.episode_left_s[i] = 0.0
            mind.recovery_left_s[i] = RECOVERY_S
            # after a freeze the driver perceives the error anew: the earlier disturbance is gone
            mind.noise[i] = 0.0
    elif mind.recovery_left_s[i] > 0.0:
        mind.recovery_left_s[i] -= STEP_S
        # a profile leading back starts at the vehicle: only the distance to its target counts
        if mind.recovery_left_s[i] <= 0.0 or abs(d - traits.offset_m[i]) < RECOVERED_M:
            mind.recovery_left_s[i] = 0.0
            if mind.cause[i] < SIGNALLED_CHANGE:
                mind.cause[i] = LANE_KEEPING

    if mind.episode_left_s[i] == 0.0 and mind.cause[i] == LANE_KEEPING and not (changing or veering) and calm:
        length = 0.0
        if mind.until_microsleep_s[i] <= 0.0:
            mind.until_microsleep_s[i] = draw_waiting(mind, traits, i, c.microsleep_rate)
            span = c.microsleep_most_s - c.microsleep_least_s
            length = c.microsleep_least_s + span * draw(mind, traits, i)
            mind.cause[i] = MICROSLEEP
        elif mind.until_glance_s[i] <= 0.0:
            mind.until_glance_s[i] = draw_waiting(mind, traits, i, c.glance_rate)
            length = math.exp(c.glance_log_mean + c.glance_log_sd * draw_normal(mind, traits, i))
            mind.cause[i] = DISTRACTION
        if length > 0.0:
            mind.episode_left_s[i] = length
            mind.held_steer_rad[i] = steer
            mind.drift_mps2[i] = c.drift_sd_mps2 * draw_normal(mind, traits, i)

    decay = math.exp(-STEP_S / c.noise_time_s)
    mind.steps[i] += 1
    kick = math.sqrt(1.0 - decay * decay) * normal(traits.noise_key[i], mind.steps[i])
    return decay * mind.noise[i] + kick


@kernel
def unrest(mind, traits, i, keep):  # type: ignore[no-untyped-def]
    """The next value of vehicle i's fast steering jitter (not scaled); to be called after `attend`."""
    kick = math.sqrt(1.0 - keep * keep) * normal(traits.noise_key[i], mind.steps[i] + _UNREST_STREAM)
    mind.calm[i] += (1.0 - keep) * (mind.unrest[i] - mind.calm[i])
    mind.unrest[i] = keep * mind.unrest[i] + kick
    return mind.unrest[i] - mind.calm[i]


@kernel
def at_speed(table, v):  # type: ignore[no-untyped-def]
    """Linear interpolation in a table (16,) at 0, 4, … 60 m/s of DriverNumbers; its ends beyond."""
    at = min(max(v, 0.0) / TABLE_SPEED_STEP_MPS, len(table) - 1.001)
    low = int(at)
    share = at - low
    return (1.0 - share) * table[low] + share * table[low + 1]


@kernel
def tightness(curvature):  # type: ignore[no-untyped-def]
    """0 in bends wider than R = 167 m, 1 in turns tighter than R = 25 m, where drivers steer harder."""
    return min(max((abs(curvature) - 0.006) / 0.034, 0.0), 1.0)


@kernel
def correction(away, drift, bandwidth, damping, most, friction_most):  # type: ignore[no-untyped-def]
    """(correction, limit) in m/s² of an attentive driver's lateral acceleration; noise is not included.

    away, drift: from the desired line, m and m/s. The limit is that of comfort (`most`), and at drifts above
    2 m/s it rises to friction.
    """
    panic = min(max(0.5 * abs(drift) - 1.0, 0.0), 1.0)
    limit = most + panic * max(friction_most - most, 0.0)
    return -bandwidth * (2.0 * damping * drift + bandwidth * away), limit
