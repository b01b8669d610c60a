"""Frames as bytes: what they depend on, and what they must not depend on."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from shots import ASPHALT, keys_of, plain, shoot

from camera_synth.camera import PROCESSED_FROM, Camera, projection, vehicle_from_image
from camera_synth.condition import PRESETS, looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from sumo_net.batch import join, select
from tests.roads import objects_at, road_ahead

N = 6
TRAFFIC = [{"forward_m": 30.0, "left_m": 0.0}, {"forward_m": 18.0, "left_m": -3.6, "height_m": 3.5}]


def fleet() -> tuple:  # type: ignore[type-arg]
    road = road_ahead(np.linspace(-1 / 300, 1 / 300, N), offset_m=np.linspace(-1, 1, N))
    objects = objects_at([TRAFFIC] * N)
    pose = Pose(np.linspace(0.0, 4e3, N), np.linspace(5e3, 6e3, N), np.linspace(0.0, 6.0, N))
    days = join(looks(preset("complex"), 4), looks(preset("night"), N - 4))
    return road, objects, pose, days, keys_of(N), np.arange(N, dtype=np.int64) * 100


def draw(parts: tuple, index: object = slice(None), first_row: int = 0) -> np.ndarray:  # type: ignore[type-arg]
    road, objects, pose, days, keys, counter = parts
    frames = new_frames(len(keys[index]))  # type: ignore[index]
    render(
        frames,
        projection(Camera()),
        select(road, index),
        select(objects, index),
        select(pose, index),
        select(days, index),
        keys[index],  # type: ignore[index]
        counter[index],  # type: ignore[index]
        first_row,
    )
    return frames


def test_same_bytes_again_in_slices_and_in_any_order() -> None:
    parts = fleet()
    whole = draw(parts)
    np.testing.assert_array_equal(draw(parts), whole)
    np.testing.assert_array_equal(np.concatenate([draw(parts, slice(0, 2)), draw(parts, slice(2, N))]), whole)
    order = np.array([3, 0, 5, 1, 4, 2])
    np.testing.assert_array_equal(draw(parts, order), whole[order])


def test_same_bytes_in_a_slice_of_the_frames() -> None:
    road, objects, pose, days, keys, counter = fleet()
    frames = new_frames(N)
    part = slice(2, 5)
    render(
        frames[part],
        projection(Camera()),
        select(road, part),
        select(objects, part),
        select(pose, part),
        select(days, part),
        keys[part],
        counter[part],
    )
    np.testing.assert_array_equal(frames[part], draw(fleet())[part])
    assert not frames[:2].any()


def test_only_the_rows_asked_for() -> None:
    parts = fleet()
    whole, part = draw(parts), draw(parts, first_row=PROCESSED_FROM)
    np.testing.assert_array_equal(part[:, PROCESSED_FROM:], whole[:, PROCESSED_FROM:])
    assert not part[:, :PROCESSED_FROM].any()


def test_key_and_counter_matter() -> None:
    road = road_ahead(np.zeros(2))
    first = shoot(road, preset("clear"), counter=5)
    assert np.mean(first[0] != first[1]) > 0.7  # same view, another key
    assert np.mean(first != shoot(road, preset("clear"), counter=6)) > 0.7


def test_contrast_fades_by_koschmieders_law() -> None:
    """Light at distance d: (own - haze) 2^(-d / visibility) + haze; on the road without any pattern."""
    camera, haze, visibility_m = Camera(), 180.0, 40.0
    frame = shoot(road_ahead(np.zeros(1)), plain(visibility_m=visibility_m, haze_grey=haze, sky_grey=haze))[0]
    for y in (5, 60, 110, 130):
        ahead, _ = vehicle_from_image(camera.center_x_px, float(y), projection(camera))
        distance = ahead - camera.forward_m
        expected = haze + (ASPHALT - haze) * 0.5 ** (distance / visibility_m)
        assert frame[239 - y, 150:170].mean() == pytest.approx(expected, abs=0.6)
    np.testing.assert_allclose(frame[:80], haze, atol=1.0)  # the trees on the horizon are out of sight


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_draws_something_to_see(name: str) -> None:
    frame = shoot(road_ahead(np.full(1, 1 / 700)), preset(name), pose=(1234.0, 567.0, 0.4))[0]
    assert 5.0 < frame[90:].mean() < 250.0
    assert frame[90:].std() > 2.0


def test_far_from_the_origin_and_at_odd_headings() -> None:
    road = road_ahead(np.zeros(3))
    condition = preset("complex")
    frames = shoot(road, condition, pose=([3e5, -8e5, 0.0], [5.6e6, 1.0, -2e5], [100.0, -7.0, 3.14159]))
    assert frames[:, 90:].std(axis=(1, 2)).min() > 5.0


def test_threads_on_slices() -> None:
    parts = fleet()
    with ThreadPoolExecutor(3) as pool:
        pieces = list(pool.map(lambda a: draw(parts, slice(a, a + 2)), (0, 2, 4)))
    np.testing.assert_array_equal(np.concatenate(pieces), draw(parts))


def test_a_vehicle_that_is_nowhere_spoils_no_other() -> None:
    road, objects, pose, days, keys, counter = fleet()
    lost = Pose(*(part.copy() for part in pose))
    lost.x_m[2] = np.nan
    lost.heading_rad[3] = np.nan
    for part in (road.left_m, road.heading_rad, road.road_left_m):
        part[1, 30:] = np.nan
    for part in (objects.length_m, objects.left_m, objects.heading_rad):
        part[4] = np.nan
    frames = draw((road, objects, lost, days, keys, counter))
    whole = draw(fleet())
    np.testing.assert_array_equal(frames[[0, 5]], whole[[0, 5]])


def test_wrong_frames_are_refused() -> None:
    parts = fleet()
    with pytest.raises(ValueError, match="first_row"):
        draw(parts, first_row=240)
    road, objects, pose, days, keys, counter = parts
    with pytest.raises(ValueError, match="new_frames"):
        render(new_frames(2), projection(Camera()), road, objects, pose, days, keys, counter)
