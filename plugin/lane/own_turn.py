"""The vehicle's own yaw rate as evidence for a lane: it is speed times curvature under the wheels, plus TURN.

The curvature ahead does not enter: a bend may begin there. Each frame's reading is a measurement of that sum.
A lane found by a new search has to explain it mostly by the road's curvature, since vehicles seldom turn
strongly against their lane. And where little of a lane is seen, one that misses the reading even after the
fit follows wrong lines, or did so before. Where the yaw rate is NaN, nothing here has an effect.
"""

import math

from plugin.lane.road_model import KNOT, SPACING_M, STATES, TURN, curvature_at
from sumo_net.compile import kernel

UNDER = 3  # number of knots at which `open_road` adds variance


@kernel
def measure(x, P, phase, speed, yaw_rate, std, along):  # type: ignore[no-untyped-def]
    """Kalman update of x, P by a yaw rate ± std, rad/s; along (STATES,) is work space for P H."""
    if not math.isfinite(yaw_rate):
        return
    part = phase / SPACING_M
    for i in range(STATES):
        along[i] = P[i, TURN] + speed * ((1.0 - part) * P[i, KNOT] + part * P[i, KNOT + 1])
    variance = along[TURN] + speed * ((1.0 - part) * along[KNOT] + part * along[KNOT + 1])
    inverse = 1.0 / (max(variance, 0.0) + std * std)
    residual = missed(x, phase, speed, yaw_rate)
    for i in range(STATES):
        x[i] += along[i] * inverse * residual
        for j in range(i + 1):
            P[i, j] = P[j, i] = P[i, j] - along[i] * inverse * along[j]


@kernel
def missed(x, phase, speed, yaw_rate):  # type: ignore[no-untyped-def]
    """Yaw rate minus that of state x, rad/s."""
    return yaw_rate - x[TURN] - speed * curvature_at(x, phase, 0.0)


@kernel
def contradicted(x, phase, speed, yaw_rate, most):  # type: ignore[no-untyped-def]
    """Whether x misses the yaw rate by more than `most`."""
    return abs(missed(x, phase, speed, yaw_rate)) > most  # False for NaN


@kernel
def expect(prior, pull, speed, yaw_rate, std):  # type: ignore[no-untyped-def]
    """Add a yaw rate ± std to a start's information `prior` (STATES, STATES) and to `pull`, prior times mean.

    At a start, knot 0 is abreast of the vehicle.
    """
    if not math.isfinite(yaw_rate):
        return
    sure = 1.0 / (std * std)
    prior[TURN, TURN] += sure
    prior[TURN, KNOT] += speed * sure
    prior[KNOT, TURN] += speed * sure
    prior[KNOT, KNOT] += speed * speed * sure
    pull[TURN] += yaw_rate * sure
    pull[KNOT] += speed * yaw_rate * sure


@kernel
def trust(x, phase, speed, yaw_rate, usual):  # type: ignore[no-untyped-def]
    """Weight of a lane's rows, 0 to 1, by the vehicle's turn against the lane over the `usual` one, rad/s."""
    if not math.isfinite(yaw_rate):
        return 1.0
    turn = (yaw_rate - speed * curvature_at(x, phase, 0.0)) / usual
    return 1.0 / (1.0 + turn * turn)


@kernel
def open_road(P, std):  # type: ignore[no-untyped-def]
    """Add variance std² (std in 1/m) to the curvature under the wheels, so that the next yaw rates set it."""
    for j in range(KNOT, KNOT + UNDER):
        P[j, j] += std * std
