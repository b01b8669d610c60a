"""Markings stand where the road's borders project to, to a small part of a pixel."""

import itertools

import numpy as np
import pytest
from shots import ASPHALT, PAINT, plain, row_of, shoot
from test_camera import project_opencv

from camera_synth.camera import Camera
from camera_synth.ground_kernels import paint_band
from sumo_net.road import AHEAD_M, OWN_RIGHT, SOLID
from tests.roads import road_ahead

LANE = 3.75
DENSE = np.arange(1.0, 190.0, 0.01)  # m of path


def border(radius: float, offset: float, heading: float, side: float) -> np.ndarray:
    """Ground points (k, 3) of a border `side` m left of the lane centre, in closed form."""
    if np.isinf(radius):
        x, y = DENSE, np.full_like(DENSE, side)
    else:
        turn = DENSE / radius
        x, y = (radius - side) * np.sin(turn), radius - (radius - side) * np.cos(turn)
    y = y - offset
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([c * x + s * y, -s * x + c * y, np.zeros_like(x)])


def columns(camera: Camera, points: np.ndarray, spread: float = 1.0) -> np.ndarray:
    """Mean column of a projected line over each of image rows 0 to 149, or at their middles (spread 0)."""
    image = project_opencv(camera, points)
    rows = np.arange(150)[:, None] + spread * np.linspace(-0.5, 0.5, 21)
    return np.asarray(np.interp(rows, image[:, 1], image[:, 0]).mean(axis=1))


def centroid(row: np.ndarray, near: float, reach: float) -> float:
    """Centre of the paint around a column."""
    first, last = max(0, int(near - reach)), min(319, int(near + reach) + 1)
    weight = (row[first : last + 1] - ASPHALT) / (PAINT - ASPHALT)
    return float(np.sum(weight * np.arange(first, last + 1)) / np.sum(weight))


@pytest.mark.parametrize(
    ("radius", "camera"),
    itertools.product(
        [np.inf, 250.0, -250.0, 800.0],
        [Camera(), Camera(yaw_rad=0.04, pitch_rad=0.06, left_m=0.3, forward_m=0.5, focal_y_px=880.0)],
    ),
)
def test_marking_centres(radius: float, camera: Camera) -> None:
    offsets, headings = [0.0, 0.9, -0.6], [0.0, 0.03, -0.05]
    road = road_ahead(1.0 / radius, offset_m=offsets, heading_error_rad=headings, kinds=[SOLID] * 4)
    frames = shoot(road, plain(edge_width_m=0.15), camera)
    checked, worst = 0, 0.0
    for i, side in itertools.product(range(3), (-0.5 * LANE, 0.5 * LANE)):
        line = columns(camera, border(radius, offsets[i], headings[i], side))
        for y in range(2, 148):
            expected = line[y]
            reach = 4.0 + 6.0 * 0.05 * (157.0 - y)
            if reach < expected < 319.0 - reach and abs(line[y + 1] - expected) < 4.0:
                found = centroid(row_of(frames[i], y), expected, reach)
                worst = max(worst, abs(found - expected))
                checked += 1
    assert checked > 200
    assert worst < 0.06


def test_a_marking_moves_by_less_than_a_pixel() -> None:
    steps = np.arange(0.0, 0.06, 0.001)
    frames = shoot(road_ahead(offset_m=steps, kinds=[SOLID] * 4), plain(edge_width_m=0.15))
    for y in (60, 95, 120):
        depth = 1.34 * 925.0 / (157.0 - y)
        x = 160.0 - 925.0 * 0.5 * LANE / depth
        found = np.array([centroid(row_of(frame, y), x, 12.0) for frame in frames])
        moved = np.diff(found)
        assert np.all(moved > 0.0)
        np.testing.assert_allclose(moved, 0.925 / depth, atol=0.02)


def test_width_and_contrast() -> None:
    road = road_ahead(kinds=[SOLID] * 4)
    frame = shoot(road, plain(marking_width_m=0.2))[0]
    for y in (60, 100, 140):
        depth = 1.34 * 925.0 / (157.0 - y)
        x = 160.0 - 925.0 * 0.5 * LANE / depth
        first = int(x - 0.15 * 925 / depth - 4)
        weight = (row_of(frame, y)[first : int(x + 0.15 * 925 / depth + 5)] - ASPHALT) / (PAINT - ASPHALT)
        # rows are lines of constant ground distance, so a straight line's width is the ground's
        assert np.sum(weight) == pytest.approx(0.2 * 925.0 / depth, rel=0.02, abs=0.03)


def test_dashes_are_anchored_at_the_edge() -> None:
    stroke, gap = 6.0, 9.0
    stations = np.array([1000.0, 1004.3, 1011.7])
    frames = shoot(road_ahead(station_m=stations), plain(dash_stroke_m=stroke, dash_gap_m=gap))
    image = project_opencv(Camera(), np.column_stack([DENSE, np.full_like(DENSE, 0.5 * LANE), 0 * DENSE]))
    for station, frame in zip(stations, frames, strict=True):
        painted = 0
        for y in range(5, 135):
            low, high = np.interp([y - 0.5, y + 0.5], image[:, 1], DENSE)
            x = float(np.interp(y, image[:, 1], image[:, 0]))
            if x < 9.0:  # cut by the image
                continue
            fine = np.linspace(low, high, 400) + station
            share = np.mean(np.mod(fine, stroke + gap) < stroke)
            cells = row_of(frame, y)[max(0, int(x) - 14) : int(x) + 15]
            weight = np.sum(cells - ASPHALT) / (PAINT - ASPHALT) / (0.15 * 925.0 / (0.5 * (low + high)))
            assert weight == pytest.approx(share, abs=0.05)
            painted += share > 0.5
        assert painted > 10


def test_kinds_and_the_end_of_the_road() -> None:
    road = road_ahead(kinds=[SOLID, 0, SOLID, SOLID])
    row = row_of(shoot(road, plain())[0], 100)
    depth = 1.34 * 925.0 / 57.0
    assert np.max(row[int(160 + 925 * 0.5 * LANE / depth) - 6 :][:13]) == pytest.approx(ASPHALT, abs=1)
    assert np.max(row[int(160 - 925 * 0.5 * LANE / depth) - 6 :][:13]) == pytest.approx(PAINT, abs=1)
    ended = road_ahead(kinds=[SOLID] * 4)
    last = int(np.searchsorted(AHEAD_M, 40.0))
    for part in (ended.forward_m, ended.left_m, ended.heading_rad, ended.curvature_1pm, ended.station_m):
        part[0, last:] = np.nan
    ended.border_offset_m[0, last:] = np.nan
    ended.border_kind[0, last:] = 0
    frame = shoot(ended, plain())[0]
    end = project_opencv(Camera(), np.array([[AHEAD_M[last - 1], 0.0, 0.0]]))[0, 1]
    assert np.all(row_of(frame, int(end) + 2) < ASPHALT - 20)
    assert np.max(row_of(frame, int(end) - 2)) > ASPHALT + 50


def test_a_border_that_begins_on_the_way() -> None:
    road = road_ahead(kinds=[SOLID] * 4)
    begin = int(np.searchsorted(AHEAD_M, 30.0))
    road.border_offset_m[0, :begin, OWN_RIGHT + 1] = np.nan
    road.border_kind[0, :begin, OWN_RIGHT + 1] = 0
    frame = shoot(road, plain())[0]
    for y, there in ((90, False), (125, True)):
        depth = 1.34 * 925.0 / (157.0 - y)
        x = int(160.0 - 925.0 * 0.5 * LANE / depth)
        assert (np.max(row_of(frame, y)[x - 4 : x + 5]) > ASPHALT + 60) == there


def test_a_vehicle_without_a_road_sees_grass() -> None:
    road = road_ahead()
    for part in road:
        if part.dtype == float:
            part[:] = np.nan
    road.border_kind[:] = 0
    frame = shoot(road, plain())[0]
    assert np.all(np.abs(frame[90:].astype(float) - 60.0) <= 1.0)


@pytest.mark.parametrize("slant", [0.0, 1e-3, 0.02, 0.7, 40.0])
def test_a_band_covers_of_each_pixel_what_lies_between_its_edges(slant: float) -> None:
    columns_px = np.arange(320.0)
    up = (np.arange(2000) + 0.5) / 2000  # over the row's height
    for left in (-30.2, -0.4, 0.5, 17.0, 101.3, 318.9, 340.0):
        for width in (0.05, 0.8, 6.3, 33.0):
            for change in (slant, -slant):
                row = np.zeros(320, np.float32)
                paint_band(row, left, left + change, left + width, left + width + 0.5 * change, 1.0, 1.0)
                l_edge, r_edge = left + change * up, left + width + 0.5 * change * up
                right_of = [np.clip(columns_px[:, None] + 0.5 - e, 0.0, 1.0) for e in (l_edge, r_edge)]
                expected = (right_of[0] - right_of[1]).mean(axis=1)
                if (l_edge < r_edge).all():
                    np.testing.assert_allclose(row, expected, atol=2e-3)
