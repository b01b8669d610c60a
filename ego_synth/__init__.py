"""Floor 2: the vehicle's own motion sensors (those of its stability control)."""
