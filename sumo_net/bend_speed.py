"""Equipped vehicles slow down for bends on edges, too; SUMO's own vehicles do so on junctions only.

On junctions SUMO limits the speed by the turn's radius. Between them it does not, and drives through a kink
of a lane's shape at the speed limit, which no car can follow.
"""

import numpy as np

from sumo_net.bend_speed_kernels import bend_speeds
from sumo_net.driver import Driver
from sumo_net.ego import EgoTruth
from sumo_net.influence import Influence
from sumo_net.road_table import RoadTable
from sumo_net.step import STEP_S
from sumo_net.traffic import Traffic


class BendSpeed:
    """Call `step` once a step, after the equipped vehicles have moved."""

    def __init__(self, driver: Driver, traffic: Traffic) -> None:
        self._lateral, self._braking = driver.bend_mps2, driver.bend_braking_mps2
        self._influence = Influence(traffic)

    def step(self, truth: EgoTruth, table: RoadTable) -> None:
        """Set SUMO's speed for the next step of vehicles that would be too fast."""
        speed = truth.speed_mps
        allowed = bend_speeds(table, truth.path, truth.station_m, speed, self._lateral, self._braking)
        for i in np.flatnonzero(speed > allowed - self._braking * STEP_S).tolist():
            wanted = min(float(allowed[i]), float(speed[i]))
            self._influence.slow_down(int(truth.handle[i]), wanted, STEP_S)
