"""The world: SUMO's traffic, the smooth road, the drivers and the lateral truth of equipped vehicles."""
