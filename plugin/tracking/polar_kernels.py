"""The IMM's prediction for the polar models, corrected for straight motion and the ego's motion."""

import math

import numpy as np

from plugin.tracking.imm_kernels import mix
from plugin.tracking.kalman_kernels import MEASURED, STATES, clear, combined, congruence
from sumo_net.compile import inlined, kernel
from sumo_net.frames import wrap_angle
from sumo_net.scratch import scratch

_NEAREST_M = 0.5


@inlined
def bend(x, G, h, sensor, v):  # type: ignore[no-untyped-def]
    """Bend a state x (6,) before its linear prediction over h, in place; G (6, 6) gets the Jacobian.

    The linear model of r and β has r̈ = β̈ = 0 for an object without acceleration. On a straight line, seen
    from a sensor with acceleration a, they are r λ² − a_r and −(2 ṙ λ + a_t)/r, λ being the rate of β over
    ground. That motion is known in closed form; (r, ṙ, β, λ) are set such that the linear model of constant
    rates gives it. G must be the identity except for the entries written here.
    """
    r, rate, azimuth, lam = max(x[0], _NEAREST_M), x[1], x[3], x[4]
    c, s = math.cos(azimuth), math.sin(azimuth)
    a_along, a_across = sensor.ax[v] * c + sensor.ay[v] * s, sensor.ay[v] * c - sensor.ax[v] * s
    # Position and velocity in the axes of the old line of sight, then along and across the new one.
    X, Y = r + (rate - 0.5 * a_along * h) * h, (r * lam - 0.5 * a_across * h) * h
    U, W = rate - a_along * h, r * lam - a_across * h
    distance, turned = math.sqrt(X * X + Y * Y), math.atan2(Y, X)
    c, s = (X / distance, Y / distance) if distance > 0.0 else (1.0, 0.0)
    r_new = max(distance, _NEAREST_M)
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
def predict(x, P, mu, rows, F, Q, markov, which, owner, dt, sensor, room):  # type: ignore[no-untyped-def]
    """`imm_kernels.predict` with each mixed state bent before F; also where that is not finite, (T,) bool.

    x (S, r, 6), P (S, r, 6, 6), mu (S, r), of which `rows` (T,) are taken; F, Q (U, r, 6, 6), markov
    (U, r, r); owner (T,) into the n vehicles with time steps dt (n,), which (n,) into U, and `sensor`, a
    SensorMotion of (n,) each. The results have T + room rows, the last ones not filled.
    """
    tracks, r, n = len(rows), x.shape[1], STATES
    xp, Pp = np.empty((tracks + room, r, n)), np.empty((tracks + room, r, n, n))
    c, lost = np.empty((tracks + room, r)), np.empty(tracks, np.bool_)
    x0, P0, w = scratch(STATES), scratch((STATES, STATES)), np.empty(r)
    G, A, out = scratch((STATES, STATES)), scratch((STATES, STATES)), scratch((STATES, STATES))
    clear(G)
    for i in range(n):
        G[i, i] = 1.0
    for t in range(tracks):
        v, s, total = owner[t], rows[t], 0.0
        u = which[v]
        for j in range(r):
            c[t, j] = mix(x[s], P[s], mu[s], markov[u], j, x0, P0, w)
            bend(x0, G, dt[v], sensor, v)
            for i in range(n):
                state = 0.0
                for a in range(n):
                    state += F[u, j, i, a] * x0[a]
                xp[t, j, i] = state
                combined(F[u, j, i], G, A[i])
            congruence(A, P0, out)
            for i in range(n):
                for b in range(n):
                    Pp[t, j, i, b] = out[i, b] + Q[u, j, i, b]
                    total += out[i, b]
        lost[t] = not math.isfinite(total)
    return xp, Pp, c, lost


@kernel
def first_velocity(owner, rate, c, s, sensor, spread):  # type: ignore[no-untyped-def]
    """Velocity over ground (vx, vy) of new objects, and σ of what the range rate leaves open, (3, B).

    Objects move along the road, so nearly along x: v_x = (ṙ + u·v_sensor)/cos β. Where the line of sight is
    nearly across (|cos β| < 0.5) the velocity is taken along the line of sight. owner (B,) into `sensor`, a
    SensorMotion; range rate, c = cos β, s = sin β (B,).
    """
    out = np.empty((3, len(owner)))
    for b in range(len(owner)):
        v = owner[b]
        radial = rate[b] + c[b] * sensor.vx[v] + s[b] * sensor.vy[v]
        # Unknown across the line of sight: v_y / cos β, or any speed up to the object's own.
        if abs(c[b]) >= 0.5:
            out[0, b], out[1, b], out[2, b] = radial / c[b], 0.0, spread / abs(c[b])
        else:
            out[0, b], out[1, b], out[2, b] = radial * c[b], radial * s[b], spread + abs(radial)
    return out


@kernel
def start(x, P, mu, z, c, s, velocity, owner, sensor, R, acceleration):  # type: ignore[no-untyped-def]
    """New tracks into x (B, r, 6), P (B, r, 6, 6), mu (B, r): all models alike and equally likely.

    z (B, 3) : range, range rate and azimuth β; c = cos β, s = sin β (B,); velocity (3, B) : that of
    `first_velocity`; acceleration : m/s², σ of each axis.
    """
    r = x.shape[1]
    for b in range(len(owner)):
        v, distance = owner[b], max(z[b, 0], 0.1)
        lam = (c[b] * (velocity[1, b] - sensor.vy[v]) - s[b] * (velocity[0, b] - sensor.vx[v])) / distance
        across, turning = velocity[2, b] / distance, acceleration / distance
        for j in range(r):
            mu[b, j] = 1.0 / r
            for i in range(STATES):
                x[b, j, i] = 0.0
                for k in range(STATES):
                    P[b, j, i, k] = 0.0
            x[b, j, 0], x[b, j, 1], x[b, j, 3], x[b, j, 4] = z[b, 0], z[b, 1], z[b, 2], lam
            for i in range(MEASURED):
                for k in range(MEASURED):
                    P[b, j, i + i // 2, k + k // 2] = R[i, k]
            P[b, j, 2, 2] = acceleration * acceleration
            P[b, j, 4, 4], P[b, j, 5, 5] = across * across, turning * turning


@kernel
def estimate(x, mu, owner, sensor, mount, cv):  # type: ignore[no-untyped-def]
    """The parts of an Estimate, (10, T), of the mixtures in the first T rows of x (S, r, 6), mu (S, r).

    owner (T,) into `sensor`, a SensorMotion; mount: m, radar ahead of the centre of gravity; cv: index of
    the constant-velocity model, -1 for none.
    """
    tracks, r = len(owner), x.shape[1]
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
