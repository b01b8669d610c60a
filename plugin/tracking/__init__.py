"""Radar tracking: Kalman filters, IMM, the adaptive filter, association, motion classes."""
