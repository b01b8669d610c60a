"""The sides of a vehicle ahead in rendered frames, against where the renderer put them."""

import math

import numpy as np
import pytest

from camera_synth.camera import Camera, image_from_vehicle, projection
from camera_synth.condition import preset
from plugin.tracking.rear_view import NOBODY, RearView, Watched, look, nobody_watched, watch
from sumo_net.surroundings import Objects
from tests.camera_synth.shots import shoot
from tests.roads import no_objects, objects_at, road_ahead

P = projection(Camera())
HALF_M = 0.9


def leaders(rear_m: np.ndarray, left_m: float = 0.0, **body: float) -> Objects:
    """One car, 1.8 m wide, ahead of each of n vehicles, its rear so far from the centre of gravity."""
    half = 0.5 * body.get("length_m", 4.6)
    rows = [
        [{"handle": 7 + i, "forward_m": rear + half, "left_m": left_m} | body]  # each of another colour
        for i, rear in enumerate(rear_m.tolist())
    ]
    return objects_at(rows)


def looking_for(x: np.ndarray, y: float = 0.0) -> Watched:
    n = len(x)
    return Watched(np.arange(n), x, np.full(n, y), np.full(n, np.nan), np.full(n, np.nan))


def columns(x: np.ndarray, y: float, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    p = projection(camera)
    sides = ((side + y) for side in (HALF_M, -HALF_M))
    left, right = (np.array([image_from_vehicle(one, side, 0.35, p)[0] for one in x]) for side in sides)
    return left, right


@pytest.mark.parametrize("condition", ["clear", "complex", "rain", "night"])
def test_sides_to_a_fraction_of_a_pixel(condition: str) -> None:
    x = np.repeat(np.linspace(9.0, 40.0, 12), 4)
    frames = shoot(road_ahead(np.zeros(len(x))), preset(condition), objects=leaders(x, 0.2))
    # the radar's range is off by a metre at most, its azimuth by some millirad
    off = np.tile([-0.8, -0.3, 0.3, 0.8], 12)
    view = look(frames, looking_for(x + off, 0.15), P)
    left, right = columns(x, 0.2, Camera())
    seen = view.track_id >= 0
    assert seen.mean() > 0.6  # in rain up to 30 m, in complex light where the road is lit evenly
    error = np.abs(view.right_px - view.left_px - (right - left))[seen]
    assert np.median(error) < 0.2
    # painted as grey as the road, a body's sides are told from the strip's shadow poorly
    assert np.quantile(error / (right - left)[seen], 0.9) < 0.08


def test_sides_of_a_van_whose_dark_strip_ends_among_the_rows_looked_at() -> None:
    """Averaged over the strip's upper end a bright body was as grey as the road: sides up to 7 % off."""
    x = np.linspace(9.0, 25.0, 32)
    van = leaders(x, width_m=1.8, length_m=6.0, height_m=2.8)
    view = look(shoot(road_ahead(np.zeros(len(x))), preset("clear"), objects=van), looking_for(x), P)
    left, right = columns(x, 0.0, Camera())
    error = np.abs((view.right_px - view.left_px) / (right - left) - 1.0)
    assert np.isfinite(error).mean() > 0.9
    assert np.nanquantile(error, 0.9) < 0.01


@pytest.mark.parametrize("heading", [-0.09, 0.09])
def test_of_a_body_that_is_askew_the_rear_is_measured_without_its_flank(heading: float) -> None:
    """The silhouette ends at the flank's far end: while a body turned, it seemed to grow by up to 10 %."""
    rear = np.linspace(10.0, 24.0, 32)
    cos, sin = math.cos(heading), math.sin(heading)
    rows = [
        [{"handle": 7 + i, "forward_m": x + 2.3 * cos, "left_m": 2.3 * sin, "heading_rad": heading}]
        for i, x in enumerate(rear.tolist())
    ]
    frames = shoot(road_ahead(np.zeros(len(rear))), preset("clear"), objects=objects_at(rows))
    view = look(frames, looking_for(rear), P)
    left, right = (
        np.array([image_from_vehicle(x - side * sin, side * cos, 0.35, P)[0] for x in rear])
        for side in (HALF_M, -HALF_M)
    )
    error = (view.right_px - view.left_px) / (right - left) - 1.0
    assert np.isfinite(error).mean() > 0.8
    assert np.nanmedian(np.abs(error)) < 0.01
    assert np.nanquantile(np.abs(error), 0.8) < 0.02


def test_a_side_that_is_not_sharp_is_doubted() -> None:
    """A flank a pixel wide is not told from the rear, and noise blurs: such widths were taken for exact."""
    x = np.linspace(10.0, 24.0, 32)
    road = road_ahead(np.zeros(len(x)))

    def doubts(condition: str, heading: float) -> np.ndarray:
        body = leaders(x, heading_rad=heading)
        return look(shoot(road, preset(condition), objects=body), looking_for(x), P).doubt_px

    sharp = np.nanmedian(doubts("clear", 0.0))
    assert sharp < 0.2
    assert np.nanmedian(doubts("clear", 0.02)) > 1.5 * sharp
    assert np.nanmedian(doubts("rain", 0.0)) > 1.2 * sharp


def test_in_an_image_scaled_unequally_heights_go_by_the_vertical_focal_length() -> None:
    camera = Camera(focal_y_px=600.0)
    x = np.linspace(12.0, 30.0, 16)
    frames = shoot(road_ahead(np.zeros(len(x))), preset("clear"), camera=camera, objects=leaders(x))
    view = look(frames, looking_for(x), projection(camera))
    left, right = columns(x, 0.0, camera)
    assert (view.track_id >= 0).mean() > 0.9
    assert np.nanmedian(np.abs(view.right_px - view.left_px - (right - left))) < 0.2


def test_own_pitch_does_not_change_the_width() -> None:
    x = np.linspace(10.0, 30.0, 8)
    road, objects = road_ahead(np.zeros(len(x))), leaders(x)
    level = look(shoot(road, preset("clear"), objects=objects), looking_for(x), P)
    width = level.right_px - level.left_px
    for pitch in (-0.004, 0.004):
        tilted = Camera(pitch_rad=Camera().pitch_rad + pitch)
        frames = shoot(road, preset("clear"), camera=tilted, objects=objects)
        known = Watched(np.arange(len(x)), x, np.zeros(len(x)), level.left_px, level.right_px)
        view = look(frames, known, P)
        assert view.right_px - view.left_px == pytest.approx(width, rel=0.01)  # 3.7 px of pitch


def test_nearer_than_its_foot_is_in_the_image_it_is_found_from_the_frame_before() -> None:
    x = np.array([6.0, 6.5, 7.0])
    frames = shoot(road_ahead(np.zeros(3)), preset("clear"), objects=leaders(x))
    assert (look(frames, looking_for(x), P).track_id == NOBODY).all()
    left, right = columns(x, 0.0, Camera())
    known = looking_for(x)._replace(left_px=left + 2.0, right_px=right - 2.0)
    view = look(frames, known, P)
    assert view.left_px == pytest.approx(left, abs=0.5)
    assert view.right_px == pytest.approx(right, abs=0.5)


def test_an_empty_road_shows_nothing() -> None:
    x = np.linspace(8.0, 60.0, 20)
    for condition in ("clear", "complex"):
        frames = shoot(road_ahead(np.zeros(20)), preset(condition), objects=no_objects(20))
        assert (look(frames, looking_for(x), P).track_id == NOBODY).all()
    assert (look(frames, nobody_watched(20), P).track_id == NOBODY).all()


def test_what_is_looked_for_next_grows_and_turns() -> None:
    view = RearView(np.array([3, 3]), np.full(2, 140.0), np.full(2, 180.0), np.zeros(2))
    now, then = (np.full(2, 20.0), np.zeros(2)), (np.full(2, 16.0), np.zeros(2))
    out = watch(np.array([3, 4]), now, then, view, np.full(2, 0.01), P)
    shift = 925.0 * math.tan(0.01)
    assert out.left_px[0] == pytest.approx(160 - 25 + shift)
    assert out.right_px[0] == pytest.approx(160 + 25 + shift)
    assert np.isnan(out.left_px[1])  # another body: nothing is known of its sides
    assert out.x_m.tolist() == [16.0, 16.0]
