"""Results of a function on a 64-bit x86 processor without AVX and fused multiply-adds."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.machines import PLAIN

ROOT = Path(__file__).parents[1]
_RUN = "import json, sys; from importlib import import_module as load; "
_RUN += "print(json.dumps(getattr(load(sys.argv[1]), sys.argv[2])()))"


def there(function: Callable[[], Any]) -> Any:
    """The answer, which has to be JSON, of a function of a test module, in a process of its own."""
    file = Path(function.__code__.co_filename).relative_to(ROOT)
    module = ".".join(file.with_suffix("").parts)  # pytest knows it by its last name alone
    done = subprocess.run(
        [sys.executable, "-c", _RUN, module, function.__name__],
        env={**os.environ, **PLAIN},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)
