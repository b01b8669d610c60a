"""What the linear polar models leave out: straight lines in polar coordinates, and the ego's own motion."""

import math

import numpy as np

from plugin.tracking.kalman_kernels import congruence
from sumo_net.compile import kernel

_NEAREST_M = 0.5


@kernel
def couple(x, P, owner, dt, sensor):  # type: ignore[no-untyped-def]
    """Bend the models before their linear prediction; x (T, r, 6), P (T, r, 6, 6), owner (T,), dt (n,).

    The linear model of r and β has r̈ = β̈ = 0 for an object without acceleration. On a straight line, seen
    from a sensor with acceleration a, they are r λ² − a_r and −(2 ṙ λ + a_t)/r, λ being the rate of β over
    ground. That motion is known in closed form; (r, ṙ, β, λ) are set to what the linear model of constant
    rates turns into it, and the covariance goes with the Jacobian. `sensor` is a SensorMotion, (n,) each.
    """
    tracks, models, n = x.shape
    x, P = x.copy(), P.copy()
    G, work = np.zeros((n, n)), np.empty((n, n))
    for i in range(n):
        G[i, i] = 1.0
    for t in range(tracks):
        v = owner[t]
        h = dt[v]
        for j in range(models):
            r, rate, azimuth, lam = max(x[t, j, 0], _NEAREST_M), x[t, j, 1], x[t, j, 3], x[t, j, 4]
            c, s = math.cos(azimuth), math.sin(azimuth)
            a_along, a_across = sensor.ax[v] * c + sensor.ay[v] * s, sensor.ay[v] * c - sensor.ax[v] * s
            # Position and velocity in the axes of the old line of sight, then along and across the new one.
            X, Y = r + (rate - 0.5 * a_along * h) * h, (r * lam - 0.5 * a_across * h) * h
            U, W = rate - a_along * h, r * lam - a_across * h
            r_new = max(math.hypot(X, Y), _NEAREST_M)
            turned = math.atan2(Y, X)
            c, s = math.cos(turned), math.sin(turned)
            rate_new, across_new = c * U + s * W, c * W - s * U
            lam_new = across_new / r_new
            x[t, j, 0], x[t, j, 1] = r_new - h * rate_new, rate_new
            x[t, j, 3], x[t, j, 4] = azimuth + turned - h * lam_new - h * sensor.yaw_rate[v], lam_new
            for column, dX, dY, dU, dW in (
                (0, 1.0, lam * h, 0.0, lam),
                (1, h, 0.0, 1.0, 0.0),
                (4, 0.0, r * h, 0.0, r),
            ):
                d_r, d_turned = c * dX + s * dY, (c * dY - s * dX) / r_new
                d_rate = c * dU + s * dW + across_new * d_turned
                d_lam = (c * dW - s * dU - rate_new * d_turned - lam_new * d_r) / r_new
                G[0, column], G[1, column] = d_r - h * d_rate, d_rate
                G[3, column], G[4, column] = d_turned - h * d_lam, d_lam
            congruence(G, P[t, j], work, P[t, j])
    return x, P
