"""Time to lane crossing, lane-departure warning, rear-end collision warning."""
