"""Kernels that find the two sides of a vehicle's rear in a frame, to a fraction of a pixel."""

import math

import numpy as np

from camera_synth.camera import image_from_vehicle
from sumo_net.compile import kernel

# Heights on the body that bound the zones in which its sides are searched: above the shadow, or, if nothing
# stands out there, on the dark strip. Lower on the strip the shadow is wider; higher, lane lines are close.
_PAINT_M = (0.22, 0.28, 0.34, 0.40, 0.46)
_STRIP_M = (0.15, 0.21)
_NEAREST_M, _FURTHEST_M = 3.0, 80.0  # nearer than this a body fills the image
_BAND_LOW_M, _BAND_HIGH_M = 0.13, 0.21  # of the dark strip at the foot; lower, its shadow is wider
_DARK = 0.65  # largest grey relative to the road's
_MIDDLE_M = 0.4  # to each side of the middle, where the foot is searched
_SLACK_M, _SLACK_PX = 1.5, 4.0  # tolerance of the foot: range error, own pitch
_ROAD_M = 2.0  # the road's grey is read this much nearer than that
_NARROWEST_M, _WIDEST_M = 1.2, 3.4
_REACH_PX, _MOST_PX = 2.0, 8.0  # tolerance of a side's column, plus in metres:
_AFTER_STRIP_M, _AFTER_FRAME_M = 0.10, 0.05
_CONTRAST = 12.0  # least grey step at a side, over the root of the rows averaged
_DISTINCT = 2.5  # and relative to the mean step beside it
_FLANK_M = 0.5  # how far inside the silhouette the rear's corner may be, as the flank shows
_QUIET = 6  # columns of the rear that are looked at before
_DOUBT = 0.6  # standard deviation of a side's column, px, relative to the unevenness of its grey
_CORNER = 3.5  # least step at the corner relative to those on the rear


@kernel
def _row(height_m, x, y, p):  # type: ignore[no-untyped-def]
    """Row (y up) of a point over the road point (x, y)."""
    _, row, _ = image_from_vehicle(x, y, height_m, p)
    return row


@kernel
def _mean(frame, row, first, last):  # type: ignore[no-untyped-def]
    """Mean grey of the columns first..last of row y = `row`."""
    total, line = 0.0, frame[frame.shape[0] - 1 - row]
    for c in range(first, last + 1):
        total += line[c]
    return total / (last - first + 1)


@kernel
def _run(line, start, step, dark):  # type: ignore[no-untyped-def]
    """Column where the dark run around `start` ends in the direction of `step`; NaN at the image's edge."""
    c = start
    while True:
        c += step
        if c < 1 or c > line.shape[0] - 2:
            return math.nan
        if line[c] >= dark and line[c + step] >= dark:
            return c - 0.5 * step


@kernel
def strip(frame, x, y, p):  # type: ignore[no-untyped-def]
    """The dark strip under a body expected at (x, y): its columns (left, right), and by how many rows its
    foot stands higher than expected.
    """
    height, width = frame.shape
    column, _, depth = image_from_vehicle(x, y, 0.0, p)
    if not depth > 3.0:
        return math.nan, math.nan, 0.0
    scale = p.focal / depth
    first, last = int(max(column - _MIDDLE_M * scale, 1)), int(min(column + _MIDDLE_M * scale, width - 2))
    lowest = max(_row(0.0, max(x - _SLACK_M, 3.0), y, p) - _SLACK_PX, 0.0)
    highest = min(_row(0.0, x + _SLACK_M, y, p) + _SLACK_PX, height - 3.0)
    road_row = max(_row(0.0, max(x - _SLACK_M - _ROAD_M, 3.0), y, p) - _SLACK_PX, 0.0)
    if last - first < 2 or road_row >= height:
        return math.nan, math.nan, 0.0
    dark = _DARK * _mean(frame, int(road_row), first, last)
    foot, before = -1, _mean(frame, int(lowest), first, last)
    if before < dark:
        return math.nan, math.nan, 0.0  # the foot is below the image
    for row in range(int(lowest) + 1, int(highest) + 1):
        if _mean(frame, row, first, last) < dark and _mean(frame, row + 1, first, last) < dark:
            foot = row
            break
    if foot < 0:
        return math.nan, math.nan, 0.0
    left, right, rows = 0.0, 0.0, 0
    rows_per_m = p.focal_y / depth
    low, high = foot + _BAND_LOW_M * rows_per_m, foot + _BAND_HIGH_M * rows_per_m
    for row in range(math.ceil(low), min(math.floor(high), height - 1) + 1):
        line = frame[height - 1 - row]
        start, nearest = -1, math.inf
        for c in range(first, last + 1):
            if line[c] < dark and abs(c - column) < nearest:
                start, nearest = c, abs(c - column)
        if start < 0:
            continue
        one, other = _run(line, start, -1, dark), _run(line, start, 1, dark)
        if _NARROWEST_M * scale <= other - one <= _WIDEST_M * scale:
            left, right, rows = left + one, right + other, rows + 1
    if rows == 0:
        return math.nan, math.nan, 0.0
    return left / rows, right / rows, foot - _row(0.0, x, y, p)


@kernel
def _profiles(frame, zones, x, y, lift, first, last, p, rows, profile):  # type: ignore[no-untyped-def]
    """Mean grey of columns first..last by zone into profile (zones, width); rows (zones,): rows averaged."""
    height = frame.shape[0]
    for z in range(len(rows)):
        low = max(round(_row(zones[z], x, y, p) + lift), 0)
        high = min(round(_row(zones[z + 1], x, y, p) + lift), height)  # that row is the next zone's
        rows[z] = max(high - low, 0)
        for c in range(first, last + 1):
            total = 0.0
            for row in range(low, high):
                total += frame[height - 1 - row, c]
            profile[z, c] = total / rows[z] if rows[z] > 0 else 0.0


@kernel
def _step_at(profile, rows, c):  # type: ignore[no-untyped-def]
    """Sum over the rows of the change of grey across column c + 1."""
    size = 0.0
    for z in range(len(rows)):  # an edge inside a pixel gives two steps of the same sign
        size += rows[z] * abs(profile[z, c + 2] - profile[z, c])
    return size


@kernel
def _silhouette(profile, rows, low, high):  # type: ignore[no-untyped-def]
    """The column before the most distinct vertical edge between two columns; -1 if none stands out.

    A body's side is vertical, so in the same column in all zones, whatever its grey in each; lane lines are
    slanted.
    """
    best, at, total = 0.0, -1, 0.0
    for c in range(low, high + 1):
        for z in range(len(rows)):
            total += rows[z] * abs(profile[z, c + 1] - profile[z, c])
        size = _step_at(profile, rows, c)
        if size > best:
            best, at = size, c
    return at if best * (high - low + 1) >= _DISTINCT * total else -1


@kernel
def _column(profile, rows, at):  # type: ignore[no-untyped-def]
    """(column, step, doubt) of the edge behind column `at`.

    The step is weighted by the root of the rows averaged. doubt : standard deviation of the column, px. The
    grey on both sides of a sharp edge is even; it is not for noise or a second edge that is not told apart.
    """
    column, weight, rest = 0.0, 0.0, 0.0
    for z in range(len(rows)):
        g = profile[z]
        before = 0.5 * (0.5 * (g[at - 2] + g[at - 1]) + g[at])
        after = 0.5 * (0.5 * (g[at + 3] + g[at + 4]) + g[at + 2])
        step = after - before
        if rows[z] > 0 and step != 0.0:
            covered = (after - g[at + 1]) / step  # share of the pixel between, as before the edge
            within = min(max(covered, 0.0), 1.0)
            column += rows[z] * step * step * within
            weight += rows[z] * step * step
            for k in range(3):
                rest += rows[z] * ((g[at - k] - before) ** 2 + (g[at + 2 + k] - after) ** 2)
            rest += rows[z] * ((covered - within) * step) ** 2
    if weight == 0.0:
        return math.nan, 0.0, 0.0
    return at + 0.5 + column / weight, math.sqrt(weight), _DOUBT * math.sqrt(rest / weight)


@kernel
def _step_in_most(profile, rows, c):  # type: ignore[no-untyped-def]
    """`_step_at` without the zone that changes most: a lamp or the slanted end of the strip is in one."""
    most = 0.0
    for z in range(len(rows)):
        most = max(most, rows[z] * abs(profile[z, c + 2] - profile[z, c]))
    return _step_at(profile, rows, c) - most


@kernel
def _corner(profile, rows, outer, outward, flank):  # type: ignore[no-untyped-def]
    """The column of the first upright edge on the way `outward` (-1 or 1) to `outer` from `flank` px inside.

    Of a body that is askew the flank shows, too, and the silhouette ends at its far end. The rear ends where
    the grey first changes in all zones by more than it does on the rear.
    """
    total, quiet = 0.0, 0
    for k in range(flank, 0, -1):
        c = outer - outward * k
        size = _step_in_most(profile, rows, c)
        if quiet >= _QUIET and size * quiet > _CORNER * total:
            edge = c
            while edge != outer and _step_at(profile, rows, edge + outward) > _step_at(profile, rows, edge):
                edge += outward
            if _column(profile, rows, edge)[1] > _CONTRAST:
                return edge
        total, quiet = total + size, quiet + 1
    return outer


@kernel
def _side(profile, rows, expected, reach, outward, flank):  # type: ignore[no-untyped-def]
    """(column, step, doubt) of the rear's side in profile (zones, width), the step 0 if no edge stands out.

    A silhouette is searched within `reach` of the expected column, the corner up to `flank` px inside of it.
    """
    low, high = max(math.floor(expected - reach), 2), min(math.ceil(expected + reach), profile.shape[1] - 5)
    if high - low < _REACH_PX:
        return math.nan, 0.0, 0.0
    at = _silhouette(profile, rows, low, high)
    if at < 0:
        return math.nan, 0.0, 0.0
    inside = profile.shape[1] - 5 - at if outward < 0 else at - 2
    corner = _corner(profile, rows, at, outward, min(flank, inside))
    return _column(profile, rows, corner)


@kernel
def sides(frame, x, y, lift, left, right, reach_m, p):  # type: ignore[no-untyped-def]
    """(left, right, doubt) columns of the sides of a body at (x, y), expected at `left` and `right`.

    doubt : standard deviation of their distance, px.

    lift : rows by which it stands higher in the image than (x, y) says. NaN where a side is not found.
    """
    width = frame.shape[1]
    scale = p.focal / max(x - p.forward, 1.0)
    reach, flank = min(_REACH_PX + reach_m * scale, _MOST_PX), int(_FLANK_M * scale)
    found, doubt = np.full(2, math.nan), 0.0
    rows, profile = np.zeros(len(_PAINT_M) - 1), np.zeros((len(_PAINT_M) - 1, width))
    for k in range(2):
        expected = left if k == 0 else right
        if not 0.0 <= expected <= width - 1.0:
            return math.nan, math.nan, 0.0
        outward = 2 * k - 1
        first = int(max(expected - reach - 4 - (flank if k == 1 else 0), 0))
        last = int(min(expected + reach + 6 + (flank if k == 0 else 0), width - 1))
        _profiles(frame, _PAINT_M, x, y, lift, first, last, p, rows, profile)
        column, step, unsure = _side(profile, rows, expected, reach, outward, flank)
        if step <= _CONTRAST:
            _profiles(frame, _STRIP_M, x, y, lift, first, last, p, rows[:1], profile)
            column, step, unsure = _side(profile[:1], rows[:1], expected, reach, outward, 0)
        if step > _CONTRAST:
            found[k], doubt = column, math.hypot(doubt, unsure)
    if not _NARROWEST_M * scale <= found[1] - found[0] <= _WIDEST_M * scale:
        return math.nan, math.nan, 0.0
    return found[0], found[1], doubt


@kernel
def look_fleet(frames, watched, p, out):  # type: ignore[no-untyped-def]
    """`RearView` of n vehicles into `out`, which is empty before; frames (n, rows, columns)."""
    for i in range(frames.shape[0]):
        x, y = watched.x_m[i], watched.y_m[i]
        if watched.track_id[i] < 0 or not _NEAREST_M < x - p.forward < _FURTHEST_M:
            continue
        # The strip at the foot cannot be a lane line behind the body; sides of the frame before can.
        left, right, lift = strip(frames[i], x, y, p)
        doubt = 0.0
        if math.isfinite(left):
            left, right, doubt = sides(frames[i], x, y, lift, left, right, _AFTER_STRIP_M, p)
        if math.isnan(left) and math.isfinite(watched.left_px[i] + watched.right_px[i]):
            left, right = watched.left_px[i], watched.right_px[i]
            left, right, doubt = sides(frames[i], x, y, 0.0, left, right, _AFTER_FRAME_M, p)
        if math.isfinite(left):
            out.track_id[i] = watched.track_id[i]
            out.left_px[i], out.right_px[i], out.doubt_px[i] = left, right, doubt


@kernel
def moved_sides(track_id, x, next_x, view, shift, forward, center):  # type: ignore[no-untyped-def]
    """Columns (2, n) of the sides in `view` (RearView) in the next frame; NaN where the body is another.

    track_id (n,) : the bodies, -1 for none, at x, then next_x (n,) m; shift (n,) : of all columns by turning;
    the camera is `forward` m ahead and its axis at column `center`.
    """
    out = np.full((2, len(track_id)), math.nan)
    for i in range(len(track_id)):
        if track_id[i] >= 0 and view.track_id[i] == track_id[i]:
            ratio = (x[i] - forward) / max(next_x[i] - forward, 1.0)
            out[0, i] = center + (view.left_px[i] - center) * ratio + shift[i]
            out[1, i] = center + (view.right_px[i] - center) * ratio + shift[i]
    return out
