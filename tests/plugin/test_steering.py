"""The front-wheel angle from two looks: answers one can compute by hand, and true drives."""

import numpy as np
import pytest
from manoeuvre import drive, looks

from plugin.motion.steering_kernels import correction, front_steer, kinematic_steer
from sumo_net.vehicle import Vehicle

HALF = Vehicle()


@pytest.mark.parametrize("v", [0.0, 10.0, 22.2, 30.0])
def test_correction_is_the_checked_one_at_half_load(v):
    assert correction(v, HALF.understeer, HALF.wheelbase_m) == pytest.approx(1 + 0.000843 * v**2, abs=5e-4)


def test_a_road_that_does_not_turn_against_the_vehicle_is_being_followed():
    assert kinematic_steer(0.002, 0.01, 0.01, 25.0, HALF.wheelbase_m, 0.1) == pytest.approx(1.96 * 0.002)


def test_kinematic_steer_is_wheelbase_times_path_curvature():
    # e_L falls by γ T on a straight road; γ = 0.25 rad/s at 25 m/s is a path of curvature 0.01
    assert kinematic_steer(0.0, -0.025, 0.0, 25.0, HALF.wheelbase_m, 0.1) == pytest.approx(1.96 * 0.01)


@pytest.mark.parametrize("speed_kmh", [50.0, 80.0, 88.0, 120.0])
@pytest.mark.parametrize("mass_kg", [960.0, 1215.0])
def test_recovers_the_steer_of_a_steady_turn(speed_kmh, mass_kg):
    vehicle, v = Vehicle(mass_kg=mass_kg), speed_kmh / 3.6
    before, now = looks(drive(vehicle, lambda *_: 0.01, lambda t: v, duration_s=3.0))[-2:]
    directions = now.preview_heading_rad[0], before.preview_heading_rad[0]
    kinematic = kinematic_steer(now.curvature_1pm[0], *directions, v, vehicle.wheelbase_m, 0.1)
    dynamic = correction(v, vehicle.understeer, vehicle.wheelbase_m) * kinematic
    assert dynamic == pytest.approx(0.01, rel=5e-3)


def published(v):
    """Eqs. 10 and 13 alone."""
    kinematic = kinematic_steer(0.004, 0.03, 0.0, v, HALF.wheelbase_m, 0.1)
    return correction(v, HALF.understeer, HALF.wheelbase_m) * kinematic


def test_goes_over_to_the_roads_curvature_when_slow():
    def steer(v):
        return front_steer(0.004, 0.03, 0.0, v, HALF.understeer, HALF.wheelbase_m, 0.1, 2.0, 5.0)

    assert steer(0.0) == steer(2.0) == pytest.approx(1.96 * 0.004)
    assert steer(5.0) == pytest.approx(published(5.0))
    assert steer(3.5) == pytest.approx(0.5 * (1.96 * 0.004 + published(3.5)))  # half-way
    values = np.array([steer(v) for v in np.linspace(0.0, 8.0, 801)])
    assert np.abs(np.diff(values)).max() < 2e-3
