"""The correction factor of the steer angle over speed (Zhang et al. 2011, section 2.2, eq. 13, figure 13).

f = δ_D / δ_k is the steer angle that a car with slip needs, over that of a car without, for the same radius.
The source prints f = 1 + 0.000843 v² for half load. Two derivations are compared: eq. 13 with the vehicle's
parameters, and the steady turn of the two-degree-of-freedom model, which does not use eq. 13.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from analysis.published import comparison
from sumo_net.vehicle import Vehicle, steady_state, steer_correction

PRINTED_PER_MPS2 = 0.000843  # half load
MASSES_KG = {"empty": 960.0, "half load": 1215.0, "full load": 1460.0}
SPEEDS_KMH = (40.0, 60.0, 80.0, 88.0, 100.0, 120.0)
_STEER_RAD = 0.01


def curves() -> pd.DataFrame:
    """f over speed, one row per load and km/h: by eq. 13, by the model's steady turn, and as printed."""
    tables = []
    for load, mass in MASSES_KG.items():
        vehicle = Vehicle(mass_kg=mass)
        kmh = np.arange(1.0, 151.0)
        v = kmh / 3.6
        yaw_rate = np.array([steady_state(vehicle, speed, _STEER_RAD)[1] for speed in v])
        tables.append(
            pd.DataFrame(
                {
                    "load": load,
                    "speed_kmh": kmh,
                    "factor": steer_correction(vehicle, v),
                    "factor_of_steady_turn": _STEER_RAD * v / (vehicle.wheelbase_m * yaw_rate),
                    "factor_printed": 1.0 + PRINTED_PER_MPS2 * v**2 if load == "half load" else np.nan,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)


def compare(curve: pd.DataFrame) -> pd.DataFrame:
    """The printed coefficient and curve at some speeds; other loads are not printed."""
    coefficient = float(steer_correction(Vehicle(), 1.0)) - 1.0
    rows = [
        comparison.row("half load", "coefficient of v²", "s²/m²", coefficient, PRINTED_PER_MPS2, "printed")
    ]
    of_half = curve[curve["load"] == "half load"].set_index("speed_kmh")
    for kmh in SPEEDS_KMH:
        found, printed = (
            float(of_half[column][kmh]) for column in ("factor_of_steady_turn", "factor_printed")
        )
        rows.append(comparison.row("half load", f"f at {kmh:g} km/h", "", found, printed, "printed"))
    for load in ("empty", "full load"):
        f = curve[(curve["load"] == load) & (curve["speed_kmh"] == 80.0)].iloc[0]
        rows.append(comparison.row(load, "f at 80 km/h", "", f["factor_of_steady_turn"]))
    return comparison.table(rows)


def reproduce(out: Path) -> pd.DataFrame:
    """Write correction_curves.csv, correction.png and the comparison into `out`; return the comparison."""
    curve = curves()
    return comparison.write(out, "correction", {"correction_curves.csv": curve}, compare(curve))
