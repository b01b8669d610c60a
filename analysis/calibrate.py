"""Estimates a camera file from pictures of a straight road.

Lane lines meet in the vanishing point: its row gives the pitch, its column the yaw. In the picture a line at
X metres left of the camera is x = x_v - (f_x / f_y) X u / h, u rows below the horizon, so that the slopes of
both lines of a lane of known width give the height h above the road. The focal length cannot be determined
from such a picture (it only scales distances): it follows from a given or assumed field of view. Pixels are
assumed to be square and the principal point to be in the middle of the picture.
"""

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.footage import FootageError, frames, open_footage
from camera_synth.camera import HEIGHT_PX, WIDTH_PX, Camera
from plugin.lane.refine import Refine, tuning
from plugin.lane.ridge import BUFFER_PX, candidates
from sumo_net.arrays import Array

HORIZONS_PX = np.arange(80.0, 200.0, 2.0)  # candidates for the vanishing point's y
COLUMNS_PX = np.arange(80.0, 242.0, 3.0)
MOST_FRAMES = 30  # of a video
THRESHOLD = tuning(Refine(contrast=8.0), 33.5)
BIN_PX, BINS = 6.0, 200
VANISHING_STD_PX = 40.0  # of the vanishing point about the picture's middle
DIRECTION_SPREAD = 0.35  # columns per row
LEAST_POINTS = 6  # on a line
LEAST_SLOPE, LEAST_SPREAD = 0.2, 0.3  # columns per row
LEAST_VOTES, PRESENT_VOTES = 3.0, 5.0  # of a line: to count at all; to be more likely there than not
CLEAR_SHARE = 0.15  # of a lane's width: closer to its border, a line may be the other one of a pair
USUAL_HEIGHT_M, HEIGHT_LOG_STD = 1.4, 0.4  # of cameras in vehicles: 1.4 m up, within a factor of 1.5
WIDTH_LOG_STD = 0.2  # of lanes, about the stated width


class Usual(NamedTuple):
    """Which spread of its lines (slope_right - slope_left) a lane usually has."""

    spread: float
    log_std: float = HEIGHT_LOG_STD


USUAL = Usual(3.7 / USUAL_HEIGHT_M)


class Lines(NamedTuple):
    """Vanishing point and lane lines of one picture."""

    vanishing_x: float
    vanishing_y: float  # up from the bottom row
    slope_left: float  # columns per row below the horizon, left line (negative)
    slope_right: float


class Proposal(NamedTuple):
    """A camera, and its basis as sentences."""

    camera: Camera
    notes: tuple[str, ...]


def calibrate(
    sources: Sequence[Path | str],
    lane_width_m: float = 3.7,
    height_m: float | None = None,
    field_of_view_rad: float = math.radians(60.0),
) -> str:
    """The camera file that `propose` finds, as TOML; its basis goes to standard error."""
    proposal = propose(sources, lane_width_m, height_m, field_of_view_rad)
    for note in proposal.notes:
        print(note, file=sys.stderr)
    return as_toml(proposal.camera)


def propose(
    sources: Sequence[Path | str],
    lane_width_m: float = 3.7,
    height_m: float | None = None,
    field_of_view_rad: float = math.radians(60.0),
) -> Proposal:
    """Propose a camera from pictures (or a video, or folders of pictures) of a straight road.

    field_of_view_rad: horizontal, of the whole picture. height_m: if known; then lane_width_m is only
    compared. Raises ValueError for values out of range,
    FootageError if nothing can be read or no picture shows a lane.
    """
    if not 2.0 <= lane_width_m <= 6.0:
        raise ValueError(f"lane_width_m = {lane_width_m}: must be 2 to 6")
    if height_m is not None and not 0.3 <= height_m <= 5.0:
        raise ValueError(f"height_m = {height_m}: must be 0.3 to 5")
    if not 0.1 <= field_of_view_rad <= 2.5:
        raise ValueError(f"field_of_view_rad = {field_of_view_rad}: must be 0.1 to 2.5")
    if not sources:
        raise FootageError("calibrate: needs at least one image")
    found: list[Lines] = []
    looked, size = 0, (WIDTH_PX, HEIGHT_PX)
    for source in sources:
        footage = open_footage(source)
        stride = max(1, footage.frame_count // MOST_FRAMES)
        for index, recorded in enumerate(frames(footage)):
            if index % stride:
                continue
            if looked and recorded.size_px != size:
                raise FootageError(
                    f"{source}: has {recorded.size_px[0]}x{recorded.size_px[1]} pixels, the images before "
                    f"{size[0]}x{size[1]}: give images of one camera"
                )
            size = recorded.size_px
            looked += 1
            lines = lane_lines(recorded.grey, _usual(size, lane_width_m, height_m))
            if lines is not None:
                found.append(lines)
    if not found:
        raise FootageError(f"{sources[0]}: shows no two lane lines that meet (looked at {looked} images)")
    return _propose(found, looked, size, lane_width_m, height_m, field_of_view_rad)


def _usual(size: tuple[int, int], lane_width_m: float, height_m: float | None) -> Usual:
    squeezed = WIDTH_PX / size[0] * size[1] / HEIGHT_PX  # f_x / f_y
    if height_m is None:
        return Usual(squeezed * lane_width_m / USUAL_HEIGHT_M)
    return Usual(squeezed * lane_width_m / height_m, WIDTH_LOG_STD)


def _propose(
    found: list[Lines],
    looked: int,
    size: tuple[int, int],
    lane_width_m: float,
    height_m: float | None,
    field_of_view_rad: float,
) -> Proposal:
    width, height = size
    x = float(np.median([line.vanishing_x for line in found]))
    y = float(np.median([line.vanishing_y for line in found]))
    spread = float(np.median([line.slope_right - line.slope_left for line in found]))
    focal_x = 0.5 * WIDTH_PX / math.tan(0.5 * field_of_view_rad)
    focal_y = focal_x * (width / WIDTH_PX) * (HEIGHT_PX / height)
    pitch = math.atan((y - 0.5 * HEIGHT_PX) / focal_y)
    yaw = math.atan((x - 0.5 * WIDTH_PX) / focal_x)
    # exact with pitch p: slope = -f_x X cos p / (f_y h)
    seen = focal_x / focal_y * math.cos(pitch) / spread
    chosen = lane_width_m * seen if height_m is None else height_m
    camera = Camera(
        height_m=round(chosen, 3),
        focal_px=round(focal_x, 1),
        focal_y_px=None if abs(focal_y - focal_x) < 0.05 else round(focal_y, 1),
        pitch_rad=round(pitch, 5),
        yaw_rad=round(yaw, 5),
    )
    notes = [
        f"{len(found)} of {looked} images show a lane; vanishing point x = {x:.1f}, y = {y:.1f} "
        f"(320x240, up from the bottom row)",
        f"taken: field of view {math.degrees(field_of_view_rad):g} degrees across (not visible in a picture: "
        f"--field-of-view), square pixels of the {width}x{height} image, principal point in its middle, the "
        "car parallel to the lane on average",
    ]
    if height_m is None:
        notes.append(f"height {chosen:.2f} m follows from a lane width of {lane_width_m:g} m (assumed)")
    else:
        notes.append(
            f"with the height of {height_m:g} m the lane is {height_m / seen:.2f} m wide "
            f"(expected {lane_width_m:g} m)"
        )
    if len(found) > 1:
        scatter = np.std([(line.vanishing_x, line.vanishing_y) for line in found], axis=0)
        notes.append(f"the vanishing point scatters by {scatter[0]:.1f} and {scatter[1]:.1f} px")
    return Proposal(camera, tuple(notes))


def as_toml(camera: Camera) -> str:
    """The camera file: one key of Camera per line."""
    names = ("height_m", "focal_px", "focal_y_px", "pitch_rad", "yaw_rad", "center_x_px", "center_y_px")
    values = [(name, getattr(camera, name)) for name in (*names, "forward_m", "left_m")]
    return "".join(f"{name} = {float(value)!r}\n" for name, value in values if value is not None)


def lane_lines(grey: Array, usual: Usual = USUAL) -> Lines | None:
    """The vanishing point and the lines of the own lane in a (240, 320) picture; None if not found."""
    points = _ridges(grey)
    found = _vanishing_point(points)
    if found is None:
        return None
    column, horizon, votes = found
    pair = _own_lane(votes, horizon, usual)
    if pair is None:
        return None
    left_line = _line(points, column, horizon, pair[0])
    right_line = _line(points, column, horizon, pair[1])
    if left_line is None or right_line is None:
        return None
    (a_left, m_left), (a_right, m_right) = left_line, right_line
    if m_right - m_left < LEAST_SPREAD:
        return None
    # intersection of x = a - m y of both sides
    y_v = (a_right - a_left) / (m_right - m_left)
    return Lines(a_left - m_left * y_v, y_v, m_left, m_right)


def _vanishing_point(points: Array) -> tuple[float, float, Array] | None:
    """(column, y) where the strongest lines of both sides meet, and the votes (BINS,) for lines through it.

    A bin is where a line meets the bottom row; the middle one is below the vanishing point.
    """
    usual_column = np.exp(-0.5 * ((COLUMNS_PX - 0.5 * WIDTH_PX) / VANISHING_STD_PX) ** 2)
    best, chosen = 0.0, None
    for horizon in HORIZONS_PX:
        x, y, direction, strength = points[horizon - points[:, 1] > 12.0].T
        if len(x) < 2 * LEAST_POINTS:
            continue
        # histogram of the columns where each point's line through (column, horizon) meets the bottom row
        slope = (x - COLUMNS_PX[:, None]) / (horizon - y)
        cell = np.floor(slope * horizon / BIN_PX).astype(int) + BINS // 2
        weight = strength * np.exp(-(((slope - direction) / DIRECTION_SPREAD) ** 2))
        weight *= np.minimum(2.0 * (horizon - y) / horizon, 1.0)  # near the horizon is much that is no road
        inside = (cell >= 0) & (cell < BINS)
        flat = (np.arange(len(COLUMNS_PX))[:, None] * BINS + cell)[inside]
        votes: Array = np.bincount(flat, weights=weight[inside], minlength=BINS * len(COLUMNS_PX)).reshape(
            -1, BINS
        )
        smooth = votes.copy()
        smooth[:, 1:-1] += 0.5 * (votes[:, :-2] + votes[:, 2:])
        # every point of a single strong line fits: only lines on both sides determine the vanishing point
        gap = _gap(horizon)
        left, right = smooth[:, : BINS // 2 - gap], smooth[:, BINS // 2 + gap :]
        score = np.sqrt(left.max(axis=1) * right.max(axis=1)) * usual_column
        score *= math.exp(-0.5 * ((horizon - 0.5 * HEIGHT_PX) / VANISHING_STD_PX) ** 2)
        k = int(np.argmax(score))
        if score[k] > best:
            chosen = float(COLUMNS_PX[k]), float(horizon), smooth[k]
            best = float(score[k])
    return chosen


def _gap(horizon: float) -> int:
    """Bins on either side of the middle that no line of the own lane falls into."""
    return int(LEAST_SLOPE * horizon / BIN_PX)


def _own_lane(votes: Array, horizon: float, usual: Usual) -> tuple[float, float] | None:
    """Slopes of the lines left and right of the camera that are the own lane's.

    The strongest lines may be the road's edges, lanes away: a line between two counts against them, and so
    does a spread at which the camera would be unusually high or low.
    """
    inner = votes[1:-1]
    peaks = 1 + np.flatnonzero((inner >= votes[:-2]) & (inner > votes[2:]))
    slope = (peaks + 0.5 - BINS // 2) * BIN_PX / horizon
    gap = _gap(horizon)
    left = peaks < BINS // 2 - gap
    right = peaks >= BINS // 2 + gap
    lines = (left | right) & (votes[peaks] > LEAST_VOTES)
    there = np.where(lines, votes[peaks] / (votes[peaks] + PRESENT_VOTES), 0.0)
    best, chosen = 0.0, None
    for i in np.flatnonzero(left & lines):
        for j in np.flatnonzero(right & lines):
            spread = slope[j] - slope[i]
            clear = CLEAR_SHARE * spread
            between = (slope > slope[i] + clear) & (slope < slope[j] - clear)
            off = math.log(spread / usual.spread) / usual.log_std
            score = math.sqrt(there[i] * there[j]) - float(there[between].max(initial=0.0))
            score *= math.exp(-0.5 * off * off)
            if score > best:
                best, chosen = score, (float(slope[i]), float(slope[j]))
    return chosen


def _line(points: Array, column: float, horizon: float, slope: float) -> tuple[float, float] | None:
    """(a, m) of x = a - m y by robust least squares (Tukey), from an initial line."""
    x, y, direction, strength = points[points[:, 1] < horizon - 5.0].T
    a, m = column + slope * horizon, slope
    for scale in (6.0, 4.0, 2.5, 2.0, 1.5):
        z = (x - (a - m * y)) / (2.0 * scale)
        weight = np.where(np.abs(z) < 1.0, (1.0 - z * z) ** 2, 0.0)
        weight *= strength * np.exp(-(((m - direction) / DIRECTION_SPREAD) ** 2))
        if np.count_nonzero(weight > 0.05 * weight.max()) < LEAST_POINTS:
            return None
        mean_y, mean_x = np.average(y, weights=weight), np.average(x, weights=weight)
        variance = np.sum(weight * (y - mean_y) ** 2)
        if variance <= 0.0:
            return None
        m = -float(np.sum(weight * (y - mean_y) * (x - mean_x)) / variance)
        a = float(mean_x + m * mean_y)
    return a, m


def _ridges(grey: Array) -> Array:
    """(M, 4) bright ridges of the lower picture: column, y, columns per row downwards, strength 0 to 1.

    The width of paint in a row depends on the unknown horizon: several are tried. The direction is that to
    the nearest ridges in the rows below and above; a ridge without any is left out.
    """
    sums, response, out = np.zeros(BUFFER_PX + 1, np.int64), np.zeros(BUFFER_PX), np.zeros((8, 2))
    rows: list[dict[float, float]] = []
    ys = np.arange(1, 150)
    for y in ys:
        found: dict[float, float] = {}
        for horizon in (105.0, 130.0, 155.0):
            width = max(1.0, 0.085 * (horizon - y))
            count = candidates(
                grey, HEIGHT_PX - 1 - int(y), 1, 0.0, 159.5, 160.0, width, 0.0, THRESHOLD, sums, response, out
            )
            for c in range(count):
                column = round(float(out[c, 0]), 1)
                found[column] = max(
                    found.get(column, 0.0), min(float(out[c, 1]) * THRESHOLD.contrast / 50.0, 1.0)
                )
        rows.append(found)
    points = []
    reach = 3
    for i in range(reach, len(ys) - reach):
        for column, strength in rows[i].items():
            below = _nearest(rows[i - reach], column)
            above = _nearest(rows[i + reach], column)
            if below is None and above is None:
                continue
            length = reach * ((below is not None) + (above is not None))
            direction = ((column if below is None else below) - (column if above is None else above)) / length
            points.append((column, float(ys[i]), direction, strength))
    return np.array(points).reshape(-1, 4)


def _nearest(row: dict[float, float], column: float) -> float | None:
    near = min(row, key=lambda x: abs(x - column), default=None)
    return near if near is not None and abs(near - column) < 14.0 else None
