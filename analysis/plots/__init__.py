"""Figures from tables, for notebooks, the command `plot` and the report page."""
