"""Reproductions of the published experiments: one module each, `reproduce(out, ...)` writes CSV and plot."""
