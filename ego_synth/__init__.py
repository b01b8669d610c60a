"""Floor 2: what a vehicle's own sensors (those of its stability control) say of its motion."""
