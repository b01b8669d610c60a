"""Image <-> ground plane: closed forms, round trips, numpy's least squares as the oracle of the fit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from camera_synth.camera import Camera, image_from_vehicle, projection, vehicle_from_image
from plugin.lane.estimate import Borders
from plugin.lane.geometry import (
    Plausibility,
    lane_estimate_from_borders,
    marking_centres,
)

CAMERA = Camera()
ROWS = np.arange(1.0, 149.0, 3.0)


def borders_of(left, right, score=50.0):
    return Borders(np.array([left]), np.array([right]), np.full((1, 2), score))


def shift(n=1):
    return np.zeros(n, np.int8)


@given(st.floats(-3.0, 3.0), st.floats(-0.002, 0.002), st.floats(20.0, 150.0))
@examples(max_examples=30)
def test_a_curved_border_is_a_hyperbola_in_the_image(offset, curvature, u):
    """SPEC 1.3, left positive: x = 160 - X₀u/h - K·h·f²/(2u). It takes the axis as level: within 0.7 %."""
    f, h = CAMERA.focal_px, CAMERA.height_m
    forward = h * f / u
    left = offset + curvature * forward**2 / 2
    x, y, _ = image_from_vehicle(forward, left, 0.0, projection(CAMERA))
    expected = -offset * u / h - curvature * h * f * f / (2 * u)
    assert x - 160.0 == pytest.approx(expected, rel=0.007, abs=1e-6)
    assert CAMERA.horizon_y_px - y == pytest.approx(u, rel=0.007)


def straight_border(offset, slope, camera):
    """The image line of left = offset + slope·X, through two of its points."""
    p = projection(camera)
    (x1, y1, _), (x2, y2, _) = (image_from_vehicle(s, offset + slope * s, 0.0, p) for s in (9.0, 50.0))
    b = (x2 - x1) / (y2 - y1)
    return [0.0, b, x1 - b * y1]


@pytest.mark.parametrize("focal_y_px", [None, 700.0])
def test_markings_centres_lie_outside_their_inner_edges(focal_y_px):
    """Edges of a lane between markings 0.2 m wide, moved by half of that, are the projected centre lines."""
    camera = Camera(pitch_rad=0.06, height_m=1.5, focal_y_px=focal_y_px)
    edges = borders_of(straight_border(1.8, 0.01, camera), straight_border(-1.7, 0.01, camera))
    centres = marking_centres(edges, camera, Plausibility(inset_m=0.1))
    assert centres.left[0] == pytest.approx(straight_border(1.9, 0.01, camera), abs=1e-9)
    assert centres.right[0] == pytest.approx(straight_border(-1.8, 0.01, camera), abs=1e-9)


@given(st.floats(2.5, 4.4), st.floats(-0.8, 0.8), st.floats(-0.05, 0.05))
@examples(max_examples=40)
def test_straight_lanes_come_back_exactly(width, offset, heading):
    camera = Camera(forward_m=1.2, left_m=0.1, yaw_rad=0.01, pitch_rad=0.05, height_m=1.3)
    half = width / 2 / np.cos(heading)
    middle, slope = -offset / np.cos(heading), -np.tan(heading)
    borders = borders_of(*(straight_border(middle + side, slope, camera) for side in (half, -half)))
    lane = lane_estimate_from_borders(borders, shift(), camera, Plausibility(inset_m=0.0))
    assert lane.locked[0]
    assert lane.lateral_offset_m[0] == pytest.approx(offset, abs=1e-6)
    assert lane.heading_error_rad[0] == pytest.approx(heading, abs=1e-7)
    assert lane.lane_width_m[0] == pytest.approx(width, abs=1e-6)
    assert lane.curvature_1pm[0] == pytest.approx(0.0, abs=1e-8)
    assert lane.preview_offset_m[0] == pytest.approx(middle + slope * camera.preview_m, abs=1e-6)
    assert lane.preview_heading_rad[0] == pytest.approx(-heading, abs=1e-7)


def best_parabola(offset, curvature):
    """a, b, c of the parabola nearest to the image of left = offset + curvature·X²/2, up to 100 m."""
    p, points = projection(CAMERA), []
    for y in ROWS:
        ahead, _ = vehicle_from_image(160.0, y, p)
        if ahead <= 100.0:
            x, row, _ = image_from_vehicle(ahead, offset + curvature * ahead**2 / 2, 0.0, p)
            if 0 <= x <= 319:
                points.append((row, x))
    return np.polyfit(*np.array(points).T, 2)


@pytest.mark.parametrize("curvature", [-1 / 800, -1 / 1500, 1 / 1000, 1 / 800])
def test_curved_lanes_come_back_within_what_a_parabola_can_show(curvature):
    """Project the road, take the best parabolas, estimate: offset within 10 cm, K within 15 %."""
    borders = borders_of(*(best_parabola(offset, curvature) for offset in (1.6, -1.95)), score=30.0)
    lane = lane_estimate_from_borders(borders, shift(), CAMERA, Plausibility(inset_m=0.0))
    assert lane.lateral_offset_m[0] == pytest.approx(0.175, abs=0.1)
    assert lane.curvature_1pm[0] == pytest.approx(curvature, rel=0.15)
    assert np.sign(lane.preview_heading_rad[0]) == np.sign(curvature)
    assert lane.score[0] == pytest.approx(0.75)


def test_the_road_fit_is_numpys():
    """Four unknowns, both borders, weighted by one pixel's error."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        left = [rng.uniform(-0.002, 0.002), rng.uniform(0.9, 1.6), rng.uniform(-80, 0)]
        right = [rng.uniform(-0.002, 0.002), rng.uniform(-1.6, -0.9), rng.uniform(340, 420)]
        lane = lane_estimate_from_borders(
            borders_of(left, right),
            shift(),
            CAMERA,
            Plausibility(
                least_width_m=0.1, greatest_width_m=20.0, greatest_heading=9.0, greatest_curvature_1pm=9.0
            ),
        )
        rows, values = [], []
        for side, (a, b, c) in enumerate((left, right)):
            for y in ROWS:
                x = a * y * y + b * y + c
                t = (y - 120.0) / 925.0
                pitch = CAMERA.pitch_rad
                forward = 1.34 * (np.cos(pitch) + t * np.sin(pitch)) / (np.sin(pitch) - t * np.cos(pitch))
                if not (0 <= x <= 319 and 0 < forward <= 60.0):
                    continue
                depth = np.cos(pitch) * forward + np.sin(pitch) * 1.34
                rows.append(np.array([1 - side, side, forward, forward**2 / 2]) / forward)
                values.append((160.0 - x) * depth / 925.0 / forward)
        (left_0, right_0, slope, bend), *_ = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)
        cos = 1 / np.hypot(1.0, slope)
        assert lane.locked[0]
        assert lane.lateral_offset_m[0] == pytest.approx(-(left_0 + right_0) / 2 * cos, abs=1e-7)
        assert lane.lane_width_m[0] == pytest.approx((left_0 - right_0) * cos + 0.15, abs=1e-7)
        there = slope + bend * CAMERA.preview_m
        assert lane.curvature_1pm[0] == pytest.approx(bend / (1 + there**2) ** 1.5, abs=1e-9)


@given(st.floats(-0.003, 0.003), st.floats(0.8, 1.7), st.floats(-90, 20), st.floats(-0.003, 0.003))
@examples(max_examples=30)
def test_mirroring_turns_every_sign(a_left, b, c, a_right):
    left, right = [a_left, b, c], [a_right, -1.3, 360.0]
    camera = Camera(center_x_px=159.5)  # the middle of columns 0 to 319
    there = lane_estimate_from_borders(borders_of(left, right), shift(), camera)
    mirrored = lane_estimate_from_borders(
        borders_of([-a_right, 1.3, 319.0 - 360.0], [-a_left, -b, 319.0 - c]), shift(), camera
    )
    assert mirrored.locked[0] == there.locked[0]
    same = ("lane_width_m",)
    turned = (
        "lateral_offset_m",
        "heading_error_rad",
        "curvature_1pm",
        "preview_offset_m",
        "preview_heading_rad",
    )
    for sign, names in ((1.0, same), (-1.0, turned)):
        for name in names:
            value = sign * getattr(there, name)
            assert getattr(mirrored, name) == pytest.approx(value, abs=1e-7, nan_ok=True), name


@pytest.mark.parametrize(
    ("left", "right", "score"),
    [
        ([0.0, 1.4, -59.0], [0.0, -1.4, 379.0], 2.0),  # hardly anything seen
        ([0.0, 0.5, 90.0], [0.0, -0.5, 230.0], 50.0),  # 1.2 m wide
        ([0.0, 1.4, 379.0], [0.0, -1.4, -59.0], 50.0),  # crossed
        ([np.nan] * 3, [np.nan] * 3, 50.0),
        ([0.0, 0.0, -500.0], [0.0, 0.0, 900.0], 50.0),  # outside the image
    ],
)
def test_implausible_borders_are_not_locked(left, right, score):
    lane = lane_estimate_from_borders(borders_of(left, right, score), shift(), CAMERA)
    assert not lane.locked[0]
    assert np.isnan(lane.lateral_offset_m[0])
    assert np.isnan(lane.curvature_1pm[0])


def test_the_order_of_the_fleet_changes_nothing():
    rng = np.random.default_rng(1)
    n = 40
    borders = Borders(
        np.column_stack([rng.normal(0, 1e-3, n), rng.normal(1.4, 0.2, n), rng.normal(-50, 30, n)]),
        np.column_stack([rng.normal(0, 1e-3, n), rng.normal(-1.4, 0.2, n), rng.normal(370, 30, n)]),
        rng.uniform(0, 60, (n, 2)),
    )
    order = rng.permutation(n)
    there = lane_estimate_from_borders(borders, shift(n), CAMERA)
    again = lane_estimate_from_borders(Borders(*(part[order] for part in borders)), shift(n), CAMERA)
    for part, other in zip(there, again, strict=True):
        np.testing.assert_array_equal(part[order], other)
