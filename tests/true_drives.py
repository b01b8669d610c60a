"""True drives of whole fleets through SUMO networks, for tests of the truth."""

from pathlib import Path

import numpy as np
import pandas as pd

from sumo_net.ego import Ego
from sumo_net.road import RoadNetwork
from sumo_net.traffic import Traffic


def all_equipped(net_file: Path, routes: str, steps: int) -> pd.DataFrame:
    """EgoTruth of all vehicles of `routes` (the elements of a route file), a row a vehicle and step.

    With the number of the `step` and SUMO's speed, `sumo_mps`.
    """
    file = net_file.with_name("all.rou.xml")
    file.write_text(f"<routes>{routes}</routes>")
    rows = []
    with Traffic.start(
        ["-n", str(net_file), "-r", str(file), "--step-length", "0.1", "--no-step-log", "true"]
    ) as traffic:
        ego = Ego(RoadNetwork.from_net_file(net_file), traffic, 1)
        for step in range(steps):
            traffic.step()
            snapshot = traffic.snapshot()
            truth = ego.step(snapshot, np.ones(len(snapshot.handle), np.bool_))
            if len(truth.handle):
                traffic.write_lateral(truth.handle, ego.front_lateral_m())
                sumo_mps = snapshot.speed_mps[snapshot.lane >= 0]
                rows.append(pd.DataFrame(truth._asdict()).assign(step=step, sumo_mps=sumo_mps))
    return pd.concat(rows)
