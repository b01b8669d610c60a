"""The pinhole camera against OpenCV's, and ground -> image -> ground."""

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from camera_synth.camera import HEIGHT_PX, Camera, image_from_vehicle, projection, vehicle_from_image

CAMERAS = st.builds(
    Camera,
    height_m=st.floats(0.8, 3.0),
    focal_px=st.floats(200.0, 1500.0),
    focal_y_px=st.one_of(st.none(), st.floats(200.0, 1500.0)),
    pitch_rad=st.floats(-0.1, 0.3),
    yaw_rad=st.floats(-0.3, 0.3),
    center_x_px=st.floats(120.0, 200.0),
    center_y_px=st.floats(80.0, 160.0),
    forward_m=st.floats(-1.0, 2.0),
    left_m=st.floats(-1.0, 1.0),
)


def project_opencv(camera: Camera, points: np.ndarray) -> np.ndarray:
    """(x, y up) of vehicle-frame points (k, 3) by cv2.projectPoints, (k, 2)."""
    c, s = np.cos(camera.yaw_rad), np.sin(camera.yaw_rad)
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # ahead, aside, up
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # right, down, ahead
    cp, sp = np.cos(camera.pitch_rad), np.sin(camera.pitch_rad)
    tilted = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    rotation = tilted @ axes @ turned
    position = np.array([camera.forward_m, camera.left_m, camera.height_m])
    matrix = np.array(
        [
            [camera.focal_px, 0.0, camera.center_x_px],
            [0.0, camera.vertical_focal_px, HEIGHT_PX - 1 - camera.center_y_px],
            [0.0, 0.0, 1.0],
        ]
    )
    image, _ = cv2.projectPoints(
        np.asarray(points, float), cv2.Rodrigues(rotation)[0], -rotation @ position, matrix, None
    )
    return np.column_stack([image[:, 0, 0], HEIGHT_PX - 1 - image[:, 0, 1]])


@given(CAMERAS, st.floats(5.0, 200.0), st.floats(-30.0, 30.0), st.floats(0.0, 4.0))
@settings(max_examples=60)
def test_projects_as_opencv(camera: Camera, forward: float, left: float, up: float) -> None:
    x, y, depth = image_from_vehicle(forward, left, up, projection(camera))
    if depth > 0.5:
        expected = project_opencv(camera, np.array([[forward, left, up]]))[0]
        np.testing.assert_allclose((x, y), expected, rtol=1e-9, atol=1e-6)


@given(CAMERAS, st.floats(5.0, 200.0), st.floats(-30.0, 30.0))
@settings(max_examples=60)
def test_ground_to_image_and_back(camera: Camera, forward: float, left: float) -> None:
    p = projection(camera)
    x, y, depth = image_from_vehicle(forward, left, 0.0, p)
    if depth > 0.5:
        back = vehicle_from_image(x, y, p)
        np.testing.assert_allclose(back, (forward, left), rtol=1e-6, atol=1e-6)


@given(CAMERAS, st.floats(5.0, 200.0), st.floats(-3.0, 3.0))
@settings(max_examples=60)
def test_a_metre_across_the_road_in_its_row(camera: Camera, forward: float, left: float) -> None:
    level = dataclasses.replace(camera, yaw_rad=0.0)
    p = projection(level)
    x, y, depth = image_from_vehicle(forward, left, 0.0, p)
    if depth > 0.5:
        further, _, _ = image_from_vehicle(forward, left - 1.0, 0.0, p)
        assert level.px_per_m(y) == pytest.approx(further - x, rel=1e-9)


@given(CAMERAS, st.floats(-100.0, 400.0), st.floats(0.001, 200.0))
@settings(max_examples=30)
def test_no_ground_above_the_horizon(camera: Camera, x: float, above: float) -> None:
    forward, left = vehicle_from_image(x, camera.horizon_y_px + above, projection(camera))
    assert np.isnan(forward)
    assert np.isnan(left)


def test_published_geometry() -> None:
    camera = Camera()
    assert camera.horizon_y_px == pytest.approx(157.0)
    assert camera.preview_m == pytest.approx(33.5)
    # the optical axis meets the road at the preview point
    assert vehicle_from_image(160.0, 120.0, projection(camera)) == pytest.approx((33.5, 0.0))
    # Z = h f / (157 - y), SPEC 1.3: a small-angle form, true within 1.5 % for the rows in use
    for y in (0.0, 75.0, 149.0):
        forward, _ = vehicle_from_image(160.0, y, projection(camera))
        assert forward == pytest.approx(1.34 * 925.0 / (157.0 - y), rel=0.015)


@pytest.mark.parametrize("pitch_rad", [-0.1, 0.0, 0.005])
def test_the_preview_point_of_a_camera_that_hardly_looks_down_is_the_usual_one(pitch_rad: float) -> None:
    assert Camera(pitch_rad=pitch_rad).preview_m == Camera().preview_m == pytest.approx(33.5)
