import numpy as np
import pytest
from manoeuvre import drive, looks

from plugin.motion.steering import dynamic_steer, kinematic_steer
from plugin.motion.steering_kernels import front_steer
from sumo_net.vehicle import Vehicle

HALF = Vehicle()


def test_correction_is_the_checked_one_at_half_load():
    speeds = np.array([0.0, 10.0, 22.2, 30.0])
    assert dynamic_steer(HALF, np.ones(4), speeds) == pytest.approx(1 + 0.000843 * speeds**2, abs=5e-4)


def test_a_road_that_does_not_turn_against_the_vehicle_is_being_followed():
    steer = kinematic_steer(HALF, np.array([0.002]), np.array([0.01]), np.array([0.01]), np.array([25.0]))
    assert steer == pytest.approx(1.96 * 0.002)


def test_kinematic_steer_is_wheelbase_times_path_curvature():
    # e_L falls by γ T on a straight road; γ = 0.25 rad/s at 25 m/s is a path of curvature 0.01
    steer = kinematic_steer(HALF, np.zeros(1), np.array([-0.025]), np.array([0.0]), np.array([25.0]))
    assert steer == pytest.approx(1.96 * 0.01)


def test_standing_vehicle_has_no_kinematic_steer():
    assert np.isnan(kinematic_steer(HALF, np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))).all()


@pytest.mark.parametrize("speed_kmh", [50.0, 80.0, 88.0, 120.0])
@pytest.mark.parametrize("mass_kg", [960.0, 1215.0])
def test_recovers_the_steer_of_a_steady_turn(speed_kmh, mass_kg):
    vehicle, v = Vehicle(mass_kg=mass_kg), speed_kmh / 3.6
    truth = drive(vehicle, lambda *_: 0.01, lambda t: v, duration_s=3.0)
    seen = looks(truth)
    kinematic = kinematic_steer(
        vehicle,
        seen[-1].curvature_1pm,
        seen[-1].preview_heading_rad,
        seen[-2].preview_heading_rad,
        np.array([v]),
    )
    assert dynamic_steer(vehicle, kinematic, np.array([v])) == pytest.approx(0.01, rel=5e-3)


def test_goes_over_to_the_roads_curvature_when_slow():
    def steer(v):
        return front_steer(0.004, 0.03, 0.0, v, HALF.understeer, HALF.wheelbase_m, 0.1, 2.0, 5.0)

    assert steer(0.0) == steer(2.0) == pytest.approx(1.96 * 0.004)
    fast = kinematic_steer(HALF, np.array([0.004]), np.array([0.03]), np.array([0.0]), np.array([5.0]))
    assert steer(5.0) == pytest.approx(dynamic_steer(HALF, fast, np.array([5.0]))[0])
    values = np.array([steer(v) for v in np.linspace(0.0, 8.0, 801)])
    assert np.abs(np.diff(values)).max() < 2e-3
