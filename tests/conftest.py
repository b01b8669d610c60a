"""Hypothesis for all tests: no time limit for an example, since the first one may compile kernels."""

from hypothesis import settings

settings.register_profile("kernels", deadline=None)
settings.load_profile("kernels")
