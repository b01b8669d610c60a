"""Metrics, evaluations, reports and commands."""
