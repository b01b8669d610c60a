"""Calls netconvert, SUMO's network converter."""

import subprocess
from pathlib import Path

from sumo_net.start_up import cause


class BuildError(RuntimeError):
    """netconvert is missing or failed."""


def netconvert(net_file: Path, *options: str) -> None:
    """Write `net_file` by netconvert with `options`, each as `--name=value`.

    Raises BuildError with netconvert's message when it fails.
    """
    import sumo  # the wheel that contains netconvert

    program = next(iter(sorted((Path(sumo.SUMO_HOME) / "bin").glob("netconvert*"))), None)
    if program is None:
        raise BuildError(f"no netconvert in {sumo.SUMO_HOME}/bin: pip install eclipse-sumo")
    command = [str(program), f"--output-file={net_file}", "--xml-validation=never", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not net_file.is_file():
        said = cause(done.stderr, done.stdout)
        raise BuildError(f"{net_file}: netconvert failed (exit {done.returncode}): {said}")
