"""The published experiments, run again: one module each, `reproduce(out, ...)` writes CSV and plot."""
