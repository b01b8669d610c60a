"""Lane detection: the published genetic parabola search, and its refinement on the ground plane."""
