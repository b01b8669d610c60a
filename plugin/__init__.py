"""What runs in the vehicle: lane detection, observers, trackers, prediction and warnings."""
