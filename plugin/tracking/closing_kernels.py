"""Kernels of the closing filter: a mixture of Singer models of a leader, measured by radar and camera."""

import math

import numpy as np

from sumo_net.compile import kernel

RANGE, SPEED, ACCELERATION, WIDTH = range(4)
_N = 4
_NEAREST_M = 0.1
MISFITS = 2  # consecutive widths that do not fit the learned one


@kernel
def _update(x, P, y, h, variance):  # type: ignore[no-untyped-def]
    """Update x (4,), P (4, 4) in place with a scalar innovation y, row h (4,); gives its log-likelihood."""
    Ph = np.zeros(_N)
    s = variance
    for i in range(_N):
        for j in range(_N):
            Ph[i] += P[i, j] * h[j]
        s += h[i] * Ph[i]
    for i in range(_N):
        x[i] += Ph[i] / s * y
        for j in range(_N):
            P[i, j] -= Ph[i] * Ph[j] / s
    return -0.5 * (y * y / s + math.log(s))


@kernel
def _spread(P, h, variance):  # type: ignore[no-untyped-def]
    """Variance h P hᵀ + variance of a scalar innovation with row h (4,)."""
    s = variance
    for i in range(_N):
        for j in range(_N):
            s += h[i] * P[i, j] * h[j]
    return s


@kernel
def _width_row(x, width_px, p, h):  # type: ignore[no-untyped-def]
    """Innovation of a width in the image; h (4,) gets the row of its derivatives."""
    depth = max(x[RANGE] + p.ahead_m, _NEAREST_M)
    expected = p.focal_px * x[WIDTH] / depth
    h[:] = 0.0
    h[RANGE], h[WIDTH] = -expected / depth, p.focal_px / depth
    return width_px - expected


@kernel
def step(x, P, mu, own_before, misfits, own, z_range, z_rate, width_px, doubt_px, fresh, d, p, out):  # type: ignore[no-untyped-def]
    """One step of T tracks over d seconds in place, the mixture's mean into out (T, 4).

    x (T, r, 4), P (T, r, 4, 4), mu (T, r), own_before and misfits (T,): a ClosingState's. own (T,): the
    radar's speed along the line of sight now. z_range, z_rate, width_px (T,) are NaN where nothing was
    measured; doubt_px (T,) is the width's standard deviation, besides `edge_px`; `fresh` ones (T,) stay as
    they are. p: ClosingNumbers.
    """
    tracks, r = len(x), x.shape[1]
    x0, P0, log_mu = np.empty((r, _N)), np.empty((r, _N, _N)), np.empty(r)
    F, A, h = np.eye(_N), np.empty((_N, _N)), np.empty(_N)
    for t in range(tracks):
        if fresh[t]:
            for a in range(_N):
                out[t, a] = x[t, 0, a]
            continue
        _mix(x[t], P[t], mu[t], p.markov, x0, P0, log_mu)
        for j in range(r):
            _predict(
                x[t, j], P[t, j], x0[j], P0[j], p.time_s[j], p.acceleration_mps2[j], d, p.width_walk_m, F, A
            )
            driven = 0.5 * (own[t] + own_before[t]) * d
            x[t, j, RANGE] = max(x[t, j, RANGE] - driven, _NEAREST_M)
        own_before[t] = own[t]
        if math.isfinite(z_range[t]):
            _measure_echo(x[t], P[t], z_range[t], z_rate[t] + own[t], p, h, log_mu)
        if math.isfinite(width_px[t]):
            misfits[t] = _measure_width(x[t], P[t], width_px[t], doubt_px[t], misfits[t], p, h, log_mu)
        _weigh(x[t], log_mu, mu[t], out[t])


@kernel
def _mix(x, P, mu, markov, x0, P0, log_mu):  # type: ignore[no-untyped-def]
    """Mix r models by their probabilities mu (r,), into x0, P0; log_mu: logarithm of the predicted ones."""
    r = len(mu)
    for j in range(r):
        total = 0.0
        for i in range(r):
            total += markov[i, j] * mu[i]
        log_mu[j] = math.log(max(total, 1e-300))
        for a in range(_N):
            x0[j, a] = 0.0
            for i in range(r):
                x0[j, a] += markov[i, j] * mu[i] / total * x[i, a]
        for a in range(_N):
            for b in range(_N):
                P0[j, a, b] = 0.0
                for i in range(r):
                    moved = (x[i, a] - x0[j, a]) * (x[i, b] - x0[j, b])
                    P0[j, a, b] += markov[i, j] * mu[i] / total * (P[i, a, b] + moved)


@kernel
def _predict(x, P, x0, P0, time, sigma, d, width_walk, F, A):  # type: ignore[no-untyped-def]
    """Predict a Singer model over d seconds from x0, P0 into x, P, without the own motion.

    The process noise is that of an acceleration that changes linearly over the step, by σ² (1 - e^(-2 d /
    time)). F: the identity at first; A (4, 4): work space.
    """
    e = math.exp(-d / time)
    F[0, 1], F[0, 2], F[1, 2], F[2, 2] = d, 0.5 * d * d, d, e
    for a in range(_N):
        x[a] = 0.0
        for b in range(_N):
            x[a] += F[a, b] * x0[b]
            A[a, b] = 0.0
            for k in range(_N):
                A[a, b] += F[a, k] * P0[k, b]
    for a in range(_N):
        for b in range(_N):
            P[a, b] = 0.0
            for k in range(_N):
                P[a, b] += A[a, k] * F[b, k]
    q = sigma**2 * (1.0 - e * e)
    g0, g1 = d * d / 6.0, 0.5 * d
    P[0, 0] += q * g0 * g0
    P[0, 1] += q * g0 * g1
    P[1, 0] += q * g0 * g1
    P[0, 2] += q * g0
    P[2, 0] += q * g0
    P[1, 1] += q * g1 * g1
    P[1, 2] += q * g1
    P[2, 1] += q * g1
    P[2, 2] += q
    P[3, 3] += width_walk**2 * d


@kernel
def _measure_echo(x, P, z_range, z_speed, p, h, log_mu):  # type: ignore[no-untyped-def]
    """Update r models by a range, if it fits, and a speed; log_mu collects their log-likelihoods."""
    fits = False  # else: a second point of a long body, metres further
    _row(h, RANGE)
    for j in range(len(x)):
        y = z_range - x[j, RANGE]
        fits = fits or y * y < p.gate * _spread(P[j], h, p.range_std_m**2)
    for j in range(len(x)):
        if fits:
            _row(h, RANGE)
            log_mu[j] += _update(x[j], P[j], z_range - x[j, RANGE], h, p.range_std_m**2)
        _row(h, SPEED)
        log_mu[j] += _update(x[j], P[j], z_speed - x[j, SPEED], h, p.rate_std_mps**2)


@kernel
def _row(h, measured):  # type: ignore[no-untyped-def]
    """h (4,) <- the row of one measured state."""
    h[:] = 0.0
    h[measured] = 1.0


@kernel
def _measure_width(x, P, width_px, doubt_px, misfits, p, h, log_mu):  # type: ignore[no-untyped-def]
    """Update r models by a width in the image, if it fits; returns how many in a row have not."""
    variance = p.edge_px**2 + (p.edge_share * width_px) ** 2 + doubt_px**2
    fits = False
    for j in range(len(x)):
        y = _width_row(x[j], width_px, p, h)
        fits = fits or y * y < p.gate * _spread(P[j], h, variance)
    misfits = 0 if fits else misfits + 1
    for j in range(len(x)):
        if misfits >= MISFITS:  # the learned width was another body's: start again
            P[j, WIDTH, :] = 0.0
            P[j, :, WIDTH] = 0.0
            P[j, WIDTH, WIDTH] = p.width_std_m**2
            x[j, WIDTH] = p.width_m
        if fits:
            y = _width_row(x[j], width_px, p, h)
            log_mu[j] += _update(x[j], P[j], y, h, variance)
    return 0 if misfits >= MISFITS else misfits


@kernel
def _weigh(x, log_mu, mu, out):  # type: ignore[no-untyped-def]
    """Probabilities mu (r,) of the models from log_mu, and the mean of their states into out (4,)."""
    highest = -math.inf
    for j in range(len(mu)):
        highest = max(highest, log_mu[j])
    total = 0.0
    for j in range(len(mu)):
        mu[j] = math.exp(log_mu[j] - highest)
        total += mu[j]
    for a in range(_N):
        out[a] = 0.0
    for j in range(len(mu)):
        mu[j] /= total
        for a in range(_N):
            out[a] += mu[j] * x[j, a]


@kernel
def _leaders(state, tracks, in_path):  # type: ignore[no-untyped-def]
    """Tracks (L,) already followed or newly in path; their rows in `state`, -1 for new ones."""
    row, before = np.empty(len(tracks.owner), np.int64), np.empty(len(tracks.owner), np.int64)
    found, at = 0, 0
    for t in range(len(tracks.owner)):
        i, track_id = tracks.owner[t], tracks.track_id[t]
        while at < len(state.owner) and (
            state.owner[at] < i or (state.owner[at] == i and state.track_id[at] < track_id)
        ):
            at += 1
        known = at < len(state.owner) and state.owner[at] == i and state.track_id[at] == track_id
        entered = False
        for k in range(in_path.shape[1]):
            entered = entered or in_path[i, k] == track_id
        if known or entered:
            row[found], before[found] = t, at if known else -1
            found += 1
    return row[:found], before[:found]


@kernel
def follow(state, tracks, detections, sensor, view, in_path, d, camera, p):  # type: ignore[no-untyped-def]
    """One scan of n vehicles: the parts of the next ClosingState, and of the improved estimate (8, T).

    Arguments as of `ClosingFilter.step`; d: seconds, camera: whether widths are taken, p: ClosingNumbers. The
    last are range, range rate, x, y, v_x, v_y, a_x and a_y.
    """
    row, before = _leaders(state, tracks, in_path)
    count, r, e = len(row), len(p.acceleration_mps2), tracks.estimate
    owner, track_id = np.empty(count, np.int64), np.empty(count, np.int64)
    x, P, mu = np.empty((count, r, _N)), np.zeros((count, r, _N, _N)), np.empty((count, r))
    misfits, fresh = np.zeros(count, np.int64), np.empty(count, np.bool_)
    own_before, own, along = np.empty(count), np.empty(count), np.empty((count, _N))
    z_range, z_rate = np.full(count, math.nan), np.full(count, math.nan)
    width, doubt = np.full(count, math.nan), np.zeros(count)
    for k in range(count):
        t, i, old = row[k], tracks.owner[row[k]], before[k]
        owner[k], track_id[k] = i, tracks.track_id[t]
        c, s = math.cos(e.azimuth_rad[t]), math.sin(e.azimuth_rad[t])
        own[k] = own_before[k] = c * sensor.vx[i] + s * sensor.vy[i]
        fresh[k] = old < 0
        if fresh[k]:
            for j in range(r):
                mu[k, j] = 1.0 / r
                x[k, j, RANGE], x[k, j, SPEED] = e.range_m[t], e.range_rate_mps[t] + own[k]
                x[k, j, ACCELERATION], x[k, j, WIDTH] = 0.0, p.width_m
                P[k, j, RANGE, RANGE] = P[k, j, SPEED, SPEED] = 0.5**2
                P[k, j, ACCELERATION, ACCELERATION], P[k, j, WIDTH, WIDTH] = 2.0**2, p.width_std_m**2
            continue
        for j in range(r):
            mu[k, j] = state.mu[old, j]
            for a in range(_N):
                x[k, j, a] = state.x[old, j, a]
                for b in range(_N):
                    P[k, j, a, b] = state.P[old, j, a, b]
        own_before[k], misfits[k] = state.own_mps[old], state.misfits[old]
        if tracks.detection[t] >= 0:
            z_range[k] = detections.range_m[tracks.detection[t]]
            z_rate[k] = detections.range_rate_mps[tracks.detection[t]]
        if camera and view.track_id[i] == track_id[k]:
            width[k], doubt[k] = view.right_px[i] - view.left_px[i], view.doubt_px[i]
    step(x, P, mu, own_before, misfits, own, z_range, z_rate, width, doubt, fresh, d, p, along)
    better = np.empty((8, len(tracks.owner)))
    for t in range(len(tracks.owner)):
        better[0, t], better[1, t], better[2, t] = e.range_m[t], e.range_rate_mps[t], e.x_m[t]
        better[3, t], better[4, t], better[5, t] = e.y_m[t], e.vx_mps[t], e.vy_mps[t]
        better[6, t], better[7, t] = e.ax_mps2[t], e.ay_mps2[t]
    for k in range(count):
        t = row[k]
        c, s = math.cos(e.azimuth_rad[t]), math.sin(e.azimuth_rad[t])
        further, faster = along[k, RANGE] - e.range_m[t], along[k, SPEED] - own[k] - e.range_rate_mps[t]
        harder = along[k, ACCELERATION] - (e.ax_mps2[t] * c + e.ay_mps2[t] * s)
        better[0, t] += further
        better[1, t] += faster
        better[2, t] += further * c
        better[3, t] += further * s
        better[4, t] += faster * c
        better[5, t] += faster * s
        better[6, t] += harder * c
        better[7, t] += harder * s
    return (owner, track_id, x, P, mu, own_before, misfits), better
