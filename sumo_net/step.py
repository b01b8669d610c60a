"""The time step of everything: SUMO must run with it, and all models are made for it."""

STEP_S = 0.1
