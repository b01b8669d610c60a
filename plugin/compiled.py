"""Whether the first steps of a run will have to compile its kernels."""

from typing import Any

from plugin.lane.refine_kernels import step_kernel
from sumo_net.compile import is_kept


def compiled() -> bool:
    """Whether the largest kernel is in the cache; also True if there is no cache to keep it."""
    kernel: Any = step_kernel  # a Dispatcher
    return kernel.stats.cache_path is None or is_kept(kernel)
