"""The last step of a running fleet as a drive of one step, to be drawn like a recorded one."""

import numpy as np

from analysis.drive import Drive
from plugin.assistance import DriverAssistance
from plugin.lane.estimate import BORDER_Y
from plugin.record import Recorder


def last_step(adas: DriverAssistance, vehicle_id: str) -> Drive | None:
    """The last step of a vehicle; None if it is not equipped or not on the road."""
    found = adas.look(vehicle_id)
    if found is None:
        return None
    seen, step, tracks = found
    memory = Recorder(adas.recorder.run_id)
    return Drive(
        vehicle_id=vehicle_id,
        run_id=adas.recorder.run_id,
        time_s=np.array([step["time_s"]]),
        frames=seen.frame[None],
        steps=adas.last_step.query("vehicle_id == @vehicle_id").reset_index(drop=True),
        tracks=tracks,
        warnings=memory.table("warnings"),
        departures=memory.table("departures"),
        conflicts=memory.table("conflicts"),
        camera=adas.configuration.camera,
        path_m=seen.path_m[None],
        border_px=seen.border_px[None],
        border_rows=BORDER_Y,
        bodies_m=seen.bodies_m[None],
        road_m=seen.road_m[None],
        road_kind=seen.road_kind[None],
    )
