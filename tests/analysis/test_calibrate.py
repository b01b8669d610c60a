"""Estimating a camera from drawn roads of known cameras and from real pictures."""

import math
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.calibrate import as_toml, calibrate, lane_lines, propose
from analysis.cli import main
from analysis.footage import FootageError
from camera_synth.camera import Camera
from sumo_net.settings import read
from tests.plugin.drawn_road import draw

DATA = Path(__file__).parents[3] / "shared" / "data" / "udacity_lane_lines"
real = pytest.mark.skipif(not DATA.is_dir(), reason="no recorded data here")


@pytest.mark.parametrize(
    "camera",
    [
        Camera(height_m=1.3, focal_px=300.0, pitch_rad=0.05),
        Camera(height_m=1.6, focal_px=280.0, pitch_rad=-0.03, yaw_rad=0.02),
    ],
)
def test_a_known_camera_is_found(tmp_path, camera):
    picture = tmp_path / "road.png"
    cv2.imwrite(str(picture), draw((1.85, -1.85), camera=camera, line_m=0.2))
    field = 2 * math.atan(160.0 / camera.focal_px)
    found = propose([picture], lane_width_m=3.7, field_of_view_rad=field).camera
    assert found.pitch_rad == pytest.approx(camera.pitch_rad, abs=0.006)
    assert found.yaw_rad == pytest.approx(camera.yaw_rad, abs=0.006)
    assert found.height_m == pytest.approx(camera.height_m, rel=0.04)
    known = propose([picture], height_m=camera.height_m, field_of_view_rad=field)
    assert known.camera.height_m == camera.height_m


@pytest.mark.parametrize("height_m", [1.1, 1.5, 2.1])
@pytest.mark.parametrize("lanes_beside", [(1, 1), (2, 0), (0, 1)])
def test_the_lines_of_the_own_lane_are_taken_not_those_of_the_road(tmp_path, height_m, lanes_beside):
    camera = Camera(height_m=height_m, focal_px=280.0, pitch_rad=0.04)
    left, right = 1.7, -1.8
    edges = (left + 3.5 * lanes_beside[0], right - 3.5 * lanes_beside[1])
    dashed = draw((left, right), camera=camera, dash_m=6.0, phase_m=4.0, sky=90.0)
    solid = draw(edges, camera=camera, line_m=0.2)
    picture = tmp_path / "road.png"
    cv2.imwrite(str(picture), np.maximum(dashed, solid))
    field = 2 * math.atan(160.0 / camera.focal_px)
    found = propose([picture], lane_width_m=left - right, field_of_view_rad=field).camera
    assert found.height_m == pytest.approx(height_m, rel=0.04)


def test_the_proposal_is_a_camera_file(tmp_path, capsys):
    picture = tmp_path / "road.png"
    cv2.imwrite(str(picture), draw(camera=Camera(focal_px=300.0, pitch_rad=0.04), line_m=0.2))
    text = calibrate([picture])
    camera = read(Camera, tomllib.loads(text), "camera.toml")
    assert as_toml(camera) == text
    told = capsys.readouterr()
    assert told.out == ""
    assert "field of view 60 degrees" in told.err


def test_the_field_of_view_is_the_users(tmp_path, capsys):
    """40 degrees across, whatever the size of the picture: 160 / tan(20°) px."""
    picture = tmp_path / "road.png"
    known = Camera(height_m=1.3, focal_px=440.0, pitch_rad=0.03)
    road = draw((1.85, -1.85), camera=known, line_m=0.2)
    cv2.imwrite(str(picture), cv2.resize(road, (640, 480)))
    with pytest.raises(SystemExit) as left:
        main(["calibrate", str(picture), "--field-of-view", "40"])
    assert not left.value.code
    told = capsys.readouterr()
    camera = read(Camera, tomllib.loads(told.out), "camera.toml")
    assert camera.focal_px == pytest.approx(160.0 / math.tan(math.radians(20.0)), abs=0.1)
    assert camera.height_m == pytest.approx(1.3, rel=0.05)
    assert camera.pitch_rad == pytest.approx(0.03, abs=0.006)
    assert "field of view 40 degrees" in told.err


def test_what_is_no_road_is_named(tmp_path):
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.full((240, 320), 90, np.uint8))
    with pytest.raises(FootageError, match="shows no two lane lines"):
        propose([grey])
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"not an image")
    with pytest.raises(FootageError, match="is not an image"):
        propose([broken])
    with pytest.raises(FootageError, match="no such file"):
        propose([tmp_path / "missing.png"])
    with pytest.raises(ValueError, match="lane_width_m = 1"):
        propose([grey], lane_width_m=1.0)


@real
def test_real_pictures_agree_on_the_camera():
    pictures = sorted(DATA.glob("*.jpg"))
    points = []
    for picture in pictures:
        grey = cv2.resize(
            cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE), (320, 240), interpolation=cv2.INTER_AREA
        )
        lines = lane_lines(grey)
        assert lines is not None, picture.name
        points.append((lines.vanishing_x, lines.vanishing_y))
    assert np.std(points, axis=0).max() < 2.5
    camera = propose(pictures).camera
    assert 1.0 < camera.height_m < 1.6  # a car's windscreen
    # pixels are square before 960x540 becomes 320x240
    assert camera.vertical_focal_px / camera.focal_px == pytest.approx(4 / 3, rel=1e-3)
    # a video gives the same as stills of the same drive
    video = propose([DATA / "solidWhiteRight.mp4"]).camera
    assert video.pitch_rad == pytest.approx(camera.pitch_rad, abs=0.01)
    assert video.height_m == pytest.approx(camera.height_m, rel=0.08)


@real
def test_pale_lines_count_more_than_trees_beyond_the_road(tmp_path):
    camera = propose(sorted(DATA.glob("*.jpg"))).camera
    for picture in sorted(DATA.glob("*.jpg")):
        pale = cv2.imread(str(picture)).astype(float)
        road = pale[330:]  # of 540 rows
        road[:] = np.clip(165.0 + 0.15 * (road - 90.0), 0, 255)
        cv2.imwrite(str(tmp_path / "pale.png"), pale.astype(np.uint8))
        found = propose([tmp_path / "pale.png"]).camera
        assert found.horizon_y_px == pytest.approx(camera.horizon_y_px, abs=6.0), picture.name
        assert found.height_m == pytest.approx(camera.height_m, rel=0.1), picture.name
