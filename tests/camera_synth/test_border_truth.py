"""The true border columns against the projection, the paint in the frame, and bodies."""

import numpy as np
import pytest
from shots import ASPHALT, plain, row_of, shoot
from test_markings import LANE, border, columns

from camera_synth.camera import Camera, projection
from camera_synth.condition import looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from camera_synth.truth import border_columns, new_border_columns
from sumo_net.road import OWN_RIGHT, SOLID
from tests.roads import no_objects, objects_at, road_ahead

SLOT = np.array([OWN_RIGHT])
ORIGIN = Pose(np.zeros(1), np.zeros(1), np.zeros(1))


@pytest.mark.parametrize("radius", [np.inf, 250.0, -400.0])
def test_columns_are_the_projection(radius: float) -> None:
    road = road_ahead(1.0 / radius, offset_m=0.4, heading_error_rad=0.02, kinds=[SOLID] * 4)
    found = border_columns(projection(Camera()), road, no_objects(1), SLOT, looks(plain(), 1), ORIGIN)
    for side, sign in ((0, 1.0), (1, -1.0)):
        expected = columns(Camera(), border(radius, 0.4, 0.02, sign * 0.5 * LANE), spread=0.0)
        inside = (expected > 0.0) & (expected < 319.0)
        np.testing.assert_allclose(found.column[0, side, inside], expected[inside], atol=0.02)
        assert np.all(np.isnan(found.column[0, side, (expected < -1.0) | (expected > 320.0)]))
        assert np.all(found.painted[0, side, inside])


def test_the_neighbouring_lane_and_slots_that_do_not_exist() -> None:
    road = road_ahead(kinds=[SOLID] * 4)
    p, days = projection(Camera()), looks(plain(), 1)
    own, next_lane, none = (
        border_columns(p, road, no_objects(1), SLOT + shift, days, ORIGIN).column for shift in (0, 1, 9)
    )
    np.testing.assert_array_equal(own[0, 0], next_lane[0, 1])
    assert np.all(np.isnan(none))


def test_painted_is_where_paint_is() -> None:
    road = road_ahead(station_m=1003.0)
    frame = shoot(road, plain())[0]
    found = border_columns(projection(Camera()), road, no_objects(1), SLOT, looks(plain(), 1), ORIGIN)
    agree = []
    for y in range(10, 130):
        x = found.column[0, 0, y]
        if x > 3:
            agree.append((row_of(frame, y)[round(x)] > ASPHALT + 60) == found.painted[0, 0, y])
    assert np.mean(agree) > 0.93  # rows at the ends of strokes may differ
    assert 0.1 < found.painted[0, 0].mean() < 0.9


def test_paint_that_is_gone_is_not_painted() -> None:
    road = road_ahead(kinds=[SOLID] * 4)
    gone = preset("clear", texture=0.0, wheel_tracks=0.0, missing=0.5, noise_grey=0.0)
    agree = []
    for x in range(0, 2000, 40):  # the patches stand in the world, so drive on to see many
        pose = Pose(np.array([float(x)]), np.zeros(1), np.zeros(1))
        frame = shoot(road, gone, pose=pose)[0]
        found = border_columns(projection(Camera()), road, no_objects(1), SLOT, looks(gone, 1), pose)
        for y in range(50, 120, 10):
            column = found.column[0, 0, y]
            if column > 3:
                contrast = float(row_of(frame, y)[round(column)]) - float(gone.asphalt_grey)
                agree.append((contrast > 25.0) == found.painted[0, 0, y])
    assert np.mean(agree) > 0.95


def test_render_gives_the_same_borders_beside() -> None:
    road = road_ahead(1 / 400.0, station_m=1003.0)
    body = objects_at([[{"forward_m": 27.0, "left_m": 1.9, "handle": 8}]])
    p, days, truth = projection(Camera()), looks(preset("complex"), 1), new_border_columns(1)
    key, counter = np.array([3], np.uint64), np.array([4])
    render(new_frames(1), p, road, body, ORIGIN, days, key, counter, 90, (SLOT, truth))
    wanted = border_columns(p, road, body, SLOT, days, ORIGIN)
    np.testing.assert_array_equal(truth.column, wanted.column)
    np.testing.assert_array_equal(truth.painted, wanted.painted)
    assert np.isfinite(truth.column).any()


def test_hidden_by_a_body() -> None:
    road = road_ahead(kinds=[SOLID] * 4)
    body = objects_at([[{"forward_m": 27.0, "left_m": 1.9, "handle": 8}]])
    found = border_columns(projection(Camera()), road, body, SLOT, looks(plain(), 1), ORIGIN).column[0]
    free = border_columns(projection(Camera()), road, no_objects(1), SLOT, looks(plain(), 1), ORIGIN).column[
        0
    ]
    frame, empty = (shoot(road, plain(), objects=o)[0] for o in (body, no_objects(1)))
    hidden = np.isnan(found[0]) & ~np.isnan(free[0])
    for y in range(70, 148):
        x = round(float(free[0, y]))
        assert hidden[y] == (row_of(frame, y)[x] != row_of(empty, y)[x]) or abs(y - hidden.argmax()) < 4
    np.testing.assert_array_equal(found[1], free[1])
