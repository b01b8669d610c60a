"""The type of arrays in annotations; docstrings and comments give shape, unit and kind."""

from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]
