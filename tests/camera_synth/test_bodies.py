"""Other vehicles: boxes at the right pixels, before what is behind them."""

import itertools

import numpy as np
import pytest
from shots import ASPHALT, plain, row_of, shoot
from test_camera import project_opencv

from camera_synth.camera import Camera
from sumo_net.road import SOLID
from tests.roads import objects_at, road_ahead


def box_corners(body: dict[str, float]) -> np.ndarray:
    """(8, 3) in the vehicle frame."""
    half_l, half_w = 0.5 * body["length_m"], 0.5 * body["width_m"]
    c, s = np.cos(body.get("heading_rad", 0.0)), np.sin(body.get("heading_rad", 0.0))
    corners = [
        (body["forward_m"] + a * c - b * s, body["left_m"] + a * s + b * c, up)
        for a, b, up in itertools.product((-half_l, half_l), (-half_w, half_w), (0.0, body["height_m"]))
    ]
    return np.array(corners)


@pytest.mark.parametrize(
    ("forward", "left", "heading"),
    [(30.0, 0.4, 0.0), (22.0, -2.5, 0.1), (50.0, 4.0, np.pi), (35.0, 1.0, -0.4)],
)
def test_a_body_covers_the_pixels_of_its_box(forward: float, left: float, heading: float) -> None:
    body = {"forward_m": forward, "left_m": left, "heading_rad": heading}
    body |= {"length_m": 4.6, "width_m": 1.8, "height_m": 1.5, "handle": -5}  # roadside: one grey, no shadow
    camera = Camera(yaw_rad=0.02)
    road = road_ahead(kinds=[0, 0, 0, 0])
    with_body = shoot(road, plain(), camera, objects_at([[body]]))[0].astype(int)
    without = shoot(road, plain(), camera)[0].astype(int)
    changed = np.abs(with_body - without) > 3
    rows, cols = np.nonzero(changed)
    image = project_opencv(camera, box_corners(body))
    assert cols.min() == pytest.approx(max(image[:, 0].min(), 0.0), abs=1.0)
    assert cols.max() == pytest.approx(min(image[:, 0].max(), 319.0), abs=1.0)
    assert 239 - rows.max() == pytest.approx(image[:, 1].min(), abs=1.0)
    assert 239 - rows.min() == pytest.approx(image[:, 1].max(), abs=1.0)


def test_a_vehicle_hides_the_marking_behind_it() -> None:
    road = road_ahead(kinds=[SOLID] * 4)
    body = {"forward_m": 27.0, "left_m": 1.9, "handle": 8}
    frame = shoot(road, plain(), objects=objects_at([[body]]))[0]
    depth = 1.34 * 925.0 / (157.0 - 120)
    x = int(160.0 - 925.0 * 1.875 / depth)
    seen = row_of(shoot(road, plain())[0], 120)[x - 3 : x + 4]
    hidden = row_of(frame, 120)[x - 3 : x + 4]
    assert np.max(seen) > 180
    assert np.ptp(hidden) < 40  # glass


def test_the_nearer_body_is_in_front_in_any_order() -> None:
    road = road_ahead()
    near = {"forward_m": 20.0, "left_m": 0.5, "handle": 3}
    far = {"forward_m": 45.0, "left_m": 0.0, "handle": 4}
    one = shoot(road, plain(), objects=objects_at([[near, far]]))
    other = shoot(road, plain(), objects=objects_at([[far, near]]))
    alone = shoot(road, plain(), objects=objects_at([[near]]))
    np.testing.assert_array_equal(one, other)
    middle = np.s_[0, 110:170, 130:170]
    np.testing.assert_array_equal(one[middle], alone[middle])


def test_a_truck_alongside_is_cut_at_the_camera() -> None:
    body = {"forward_m": 6.0, "left_m": -3.2, "length_m": 16.0, "width_m": 2.5, "height_m": 4.0, "handle": 2}
    frame = shoot(road_ahead(), plain(), objects=objects_at([[body]]))[0]
    empty = shoot(road_ahead(), plain())[0]
    changed = np.nonzero(np.any(frame != empty, axis=0))[0]
    # its front's near edge, 14 m ahead and 1.95 m to the right, is the leftmost thing seen of it, but for
    # the shadow 0.15 m around it
    assert changed.min() == pytest.approx(160 + 925 * 1.8 / 14.15, abs=2)
    assert changed.max() == 319


def test_bodies_behind_or_around_the_camera_draw_nothing() -> None:
    empty = shoot(road_ahead(), plain())
    for body in ({"forward_m": -20.0, "left_m": 0.0}, {"forward_m": 0.0, "left_m": 0.0}):
        np.testing.assert_array_equal(shoot(road_ahead(), plain(), objects=objects_at([[body]])), empty)


def test_a_vehicle_casts_a_shadow_under_it() -> None:
    body = {"forward_m": 30.0, "left_m": 0.0, "handle": 6}
    frame = shoot(road_ahead(), plain(), objects=objects_at([[body]]))[0]
    below = project_opencv(Camera(), np.array([[30.0 - 2.3 - 0.1, 0.0, 0.0]]))[0, 1]
    assert row_of(frame, int(np.floor(below)))[160] < 0.7 * ASPHALT
