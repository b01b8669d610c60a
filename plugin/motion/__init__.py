"""Steering estimate, observer bank and trajectory prediction (Zhang et al. 2011, sections 2 to 4)."""
