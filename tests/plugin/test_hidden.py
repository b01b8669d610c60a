"""Areas hidden by vehicles ahead: against the rendered bodies, and the treatment of ridges in them."""

import numpy as np
import pytest

from camera_synth.camera import Camera, image_from_vehicle, projection
from plugin.lane.hidden import (
    BODIES,
    FIRST,
    FOOT,
    LAST,
    Bodies,
    hidden_by,
    nothing_hidden,
    outline,
    without_hidden,
)
from plugin.ranging_kernels import axis_of

P = projection(Camera())
RADAR_M = 1.6
ROAD, DARK, BODY = 100, 20, 150


def bodies(*places: tuple[float, float]) -> Bodies:
    """Bodies along the own axis, more or less."""
    x, y = np.array(places, float).T
    return Bodies(np.zeros(len(x), np.int64), x, y, np.zeros(len(x)), np.full(len(x), 0.2))


def frame_with(x: float, left: float, right: float) -> np.ndarray:
    """A grey road and the rear of a body on it, from `left` to `right` (m), with a dark strip below."""
    frame = np.full((240, 320), ROAD, np.uint8)
    for low, high, grey in ((0.0, 0.45, DARK), (0.45, 1.5, BODY)):
        first, foot, _ = image_from_vehicle(x, left, low, P)
        last, top, _ = image_from_vehicle(x, right, high, P)
        frame[239 - round(top) : 239 - round(foot), max(round(first), 0) : min(round(last), 319) + 1] = grey
    return frame


def test_rows_above_the_foot_and_columns_of_the_body_are_hidden() -> None:
    hidden = hidden_by(bodies((20.0, -3.0), (40.0, 0.0)), 1, P, RADAR_M)[0]
    for b, (x, low, high) in enumerate(((20.0, -5.3, -2.75), (40.0, -1.15, 1.15))):
        assert hidden[b, FOOT] == pytest.approx(image_from_vehicle(x, 0.0, 0.0, P)[1], abs=0.5)
        assert hidden[b, FIRST] <= image_from_vehicle(x, high, 0.0, P)[0]
        assert hidden[b, LAST] >= image_from_vehicle(x, low, 0.0, P)[0]
    assert np.isinf(hidden[2:, FOOT]).all()


@pytest.mark.parametrize(("left", "right", "point"), [(2.6, 0.9, 0.9), (0.4, -1.3, 0.3), (-1.0, -2.8, -1.0)])
def test_the_frame_says_how_wide_the_body_stands_there(left: float, right: float, point: float) -> None:
    """Whichever corner of a body that changes lanes the radar sees."""
    frame = frame_with(18.0, left, right)
    for seen in (point, left, right):
        hidden = hidden_by(bodies((18.0, seen)), 1, P, RADAR_M)[0]
        outline(frame, hidden, P)
        first, last = (image_from_vehicle(18.0, aside, 0.0, P)[0] for aside in (left, right))
        side = 0.3  # of the way to the vanishing point: the body's side, up to its front, shows too
        assert first - 6.0 - side * max(first - P.center_x, 0.0) <= hidden[0, FIRST] <= first
        assert last <= hidden[0, LAST] <= last + 6.0 + side * max(P.center_x - last, 0.0)


def test_without_a_dark_strip_the_guess_stands() -> None:
    hidden = hidden_by(bodies((18.0, -1.0)), 1, P, RADAR_M)[0]
    guess = hidden.copy()
    outline(np.full((240, 320), ROAD, np.uint8), hidden, P)
    assert hidden[0, FIRST] == pytest.approx(guess[0, FIRST], abs=2.1)
    assert hidden[0, LAST] == pytest.approx(guess[0, LAST], abs=2.1)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_body_that_is_passed_hides_its_own_side_only(side: float) -> None:
    """Its foot is below the image, so no frame says how wide it is; the own heading brings it to the axis."""
    body = Bodies(np.zeros(1, np.int64), *(np.array([v]) for v in (5.6, side * 0.52, -side * 0.05, 0.015)))
    hidden = hidden_by(body, 1, P, RADAR_M)[0]
    outline(np.full((240, 320), ROAD, np.uint8), hidden, P)
    if side > 0:
        assert hidden[0, FIRST] < 0.0
        assert hidden[0, LAST] < 150.0
    else:
        assert hidden[0, FIRST] > 170.0
        assert hidden[0, LAST] > 319.0


def test_ridges_on_a_body_are_dropped_and_those_nearer_are_not() -> None:
    hidden = hidden_by(bodies((20.0, 0.0)), 1, P, RADAR_M)[0]
    foot, middle = hidden[0, FOOT], 0.5 * (hidden[0, FIRST] + hidden[0, LAST])
    ridge = np.array([[middle, 3.0], [hidden[0, LAST] + 5.0, 4.0], [middle + 1.0, 5.0]])
    assert without_hidden(ridge.copy(), 3, foot - 5.0, hidden) == 3
    kept = ridge.copy()
    assert without_hidden(kept, 3, foot + 5.0, hidden) == 1
    assert kept[0].tolist() == [hidden[0, LAST] + 5.0, 4.0]
    assert without_hidden(ridge.copy(), 3, foot + 5.0, nothing_hidden(1)[0]) == 3


def test_only_the_nearest_count_and_each_vehicle_has_its_own() -> None:
    owner = np.repeat([0, 1], [BODIES + 3, 1])
    zeros = np.zeros(len(owner))
    many = Bodies(owner, np.r_[np.arange(BODIES + 3.0) * 4 + 10, 30.0], zeros, zeros, zeros)
    hidden = hidden_by(many, 2, P, RADAR_M)
    assert np.isfinite(hidden[0, :, FOOT]).all()
    assert np.isfinite(hidden[1, :, FOOT]).sum() == 1
    assert hidden[1, 0, FOOT] == pytest.approx(image_from_vehicle(30.0, 0.0, 0.0, P)[1])


def test_a_bodys_axis_is_that_of_its_velocity_whichever_way_it_drives() -> None:
    ahead, oncoming = axis_of(30.0, 1.5), axis_of(-30.0, -1.5)
    assert ahead == oncoming == pytest.approx((0.05, 0.5 / 30.0), rel=1e-2)
    assert axis_of(1.0, 0.5) == (0.0, 0.2)  # hardly known of one in a queue
    assert axis_of(0.0, 8.0) == (0.0, 0.2)  # or one that crosses
