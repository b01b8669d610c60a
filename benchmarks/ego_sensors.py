"""Noise and resolution of a recorded car's own sensors, the basis of the defaults of EgoSensors.

python benchmarks/ego_sensors.py FOLDER, which holds gyro.csv, steering.csv, speed.csv and radar.csv of a
comma2k19 segment (one minute of freeway). Changes between samples that are faster than a car's motion are
noise: measured by second differences, and for the gyroscope, which body vibration shakes, by the spectrum
between 5 Hz and 10 Hz. The wheel speed's scale is compared with the Doppler speed of stationary objects.
"""

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import welch

_STANDS_MPS = 1.0  # over ground, by radar and wheels: slower objects count as stationary


def noise(values: np.ndarray) -> float:
    """Standard deviation of white noise on a signal whose second difference is small."""
    return float(np.std(np.diff(values, 2)) / math.sqrt(6.0))


def resolution(values: np.ndarray) -> float:
    """Typical step between neighbouring values."""
    return float(np.median(np.round(np.diff(np.unique(values)), 6)))


def within(values: np.ndarray, rate_hz: float, low_hz: float, high_hz: float) -> float:
    """Root mean square of the signal between two frequencies."""
    frequency, power = welch(values, rate_hz, nperseg=512)
    inside = (frequency >= low_hz) & (frequency < high_hz)
    return float(np.sqrt(np.trapezoid(power[inside], frequency[inside])))


def evenly(table: pd.DataFrame, column: str, rate_hz: float = 100.0) -> np.ndarray:
    """A column resampled to a uniform time grid."""
    time = np.arange(table["time_s"].iloc[0], table["time_s"].iloc[-1], 1.0 / rate_hz)
    return np.interp(time, table["time_s"], table[column])


def main(folder: Path) -> None:
    """Print the figures."""
    gyro, steering, speed, radar = (
        pd.read_csv(folder / f"{name}.csv") for name in ("gyro", "steering", "speed", "radar")
    )
    yaw = evenly(gyro, "gyro_z_radps")
    floor = within(yaw, 100.0, 5.0, 10.0) / math.sqrt(5.0)
    wheel = np.radians(evenly(steering, "steering_wheel_angle_deg"))
    print(f"yaw rate (device)  resolution {resolution(gyro['gyro_z_radps'].to_numpy()):.5f} rad/s")
    print(f"                   noise {floor * math.sqrt(5.0):.5f} rad/s in 5 Hz, the band of a 10 Hz reading")
    angle = steering["steering_wheel_angle_deg"].to_numpy()
    print(f"steering wheel     resolution {resolution(angle):.2f} °, noise {noise(angle):.3f} °")
    quick = math.degrees(within(wheel, 100.0, 1.0, 3.0))
    print(f"                   {quick:.2f} ° between 1 Hz and 3 Hz (the driver's unrest)")
    print(f"wheel speed        noise {noise(speed['speed_mps'].to_numpy()):.4f} m/s")
    own = np.interp(radar["time_s"], speed["time_s"], speed["speed_mps"])
    stands = (radar["relative_speed_mps"] + own).abs() < _STANDS_MPS
    aside = np.hypot(radar["forward_m"], radar["left_m"]) / radar["forward_m"]
    ratio = (-radar["relative_speed_mps"] * aside / own)[stands]
    print(f"                   Doppler over wheel speed {ratio.median():.4f}, {len(ratio)} echoes that stand")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
