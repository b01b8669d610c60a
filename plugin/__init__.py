"""The functions in the vehicle: lane detection, observers, trackers, prediction and warnings."""

from plugin.assistance import DriverAssistance

__all__ = ["DriverAssistance"]
