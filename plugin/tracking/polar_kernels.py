"""The IMM's prediction for the polar models, with what those leave out: straight lines, the ego's motion."""

import math

import numpy as np

from plugin.tracking.imm_kernels import mix_one
from plugin.tracking.kalman_kernels import STATES, congruence
from sumo_net.compile import inlined, kernel
from sumo_net.frames import wrap_angle

_NEAREST_M = 0.5


@inlined
def bend(x, G, h, sensor, v):  # type: ignore[no-untyped-def]
    """Bend a state x (6,) before its linear prediction over h, in place; G (6, 6) gets the Jacobian.

    The linear model of r and β has r̈ = β̈ = 0 for an object without acceleration. On a straight line, seen
    from a sensor with acceleration a, they are r λ² − a_r and −(2 ṙ λ + a_t)/r, λ being the rate of β over
    ground. That motion is known in closed form; (r, ṙ, β, λ) are set to what the linear model of constant
    rates turns into it. G has to be the identity but for the entries written here.
    """
    r, rate, azimuth, lam = max(x[0], _NEAREST_M), x[1], x[3], x[4]
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
    x[0], x[1] = r_new - h * rate_new, rate_new
    x[3], x[4] = azimuth + turned - h * lam_new - h * sensor.yaw_rate[v], lam_new
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


@kernel
def predict(x, P, mu, F, Q, markov, which, owner, dt, sensor):  # type: ignore[no-untyped-def]
    """`imm_kernels.predict` with each mixed state bent before F.

    x (T, r, 6), P (T, r, 6, 6), mu (T, r); F, Q (U, r, 6, 6), markov (U, r, r), which (T,) into U; owner (T,)
    into the n vehicles with time steps dt (n,) and `sensor`, a SensorMotion of (n,) each.
    """
    tracks, r, n = len(x), x.shape[1], STATES
    xp, Pp, c = np.empty_like(x), np.empty_like(P), np.empty_like(mu)
    x0, P0, w, work = np.empty((r, n)), np.empty((r, n, n)), np.empty(r), np.empty((n, n))
    G, A, out = np.eye(n), np.empty((n, n)), np.empty((n, n))
    for t in range(tracks):
        u, v = which[t], owner[t]
        mix_one(x[t], P[t], mu[t], markov[u], x0, P0, c[t], w)
        for j in range(r):
            bend(x0[j], G, dt[v], sensor, v)
            for i in range(n):
                total = 0.0
                for b in range(n):
                    A[i, b] = 0.0
                for a in range(n):
                    f = F[u, j, i, a]
                    if f != 0.0:
                        total += f * x0[j, a]
                        for b in range(n):
                            A[i, b] += f * G[a, b]
                xp[t, j, i] = total
            congruence(A, P0[j], work, out)
            for i in range(n):
                for b in range(n):
                    Pp[t, j, i, b] = out[i, b] + Q[u, j, i, b]
    return xp, Pp, c


@kernel
def estimate(x, mu, owner, sensor, mount, cv):  # type: ignore[no-untyped-def]
    """The parts of an Estimate, (10, T), of the mixtures x (T, r, 6), mu (T, r).

    owner (T,) into `sensor`, a SensorMotion; mount: of the radar, ahead of the centre of gravity; cv: the
    model of constant velocity, -1 for none.
    """
    tracks, r = len(x), x.shape[1]
    out, mean = np.empty((10, tracks)), np.empty(STATES)
    for t in range(tracks):
        for a in range(STATES):
            mean[a] = 0.0
            for j in range(r):
                mean[a] += mu[t, j] * x[t, j, a]
        distance, rate, azimuth = mean[0], mean[1], mean[3]
        c, s = math.cos(azimuth), math.sin(azimuth)
        across, turning = distance * mean[4], distance * mean[5]
        out[0, t], out[1, t], out[2, t] = distance, rate, wrap_angle(azimuth)
        out[3, t], out[4, t] = distance * c + mount, distance * s
        out[5, t] = rate * c - across * s + sensor.vx[owner[t]]
        out[6, t] = rate * s + across * c + sensor.vy[owner[t]]
        out[7, t], out[8, t] = mean[2] * c - turning * s, mean[2] * s + turning * c
        out[9, t] = mu[t, cv] if cv >= 0 else math.nan
    return out
