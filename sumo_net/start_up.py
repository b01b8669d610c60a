"""Starting SUMO: SUMO_HOME, the cause of a failure, the side of the traffic."""

import contextlib
import os
import re
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sumo_net.xml_input import XmlInputError, root_element


def set_sumo_home() -> None:
    """Set SUMO_HOME if missing: SUMO reads its XML schemas there, or else from the internet."""
    if "SUMO_HOME" not in os.environ:
        with contextlib.suppress(ImportError):
            import sumo

            os.environ["SUMO_HOME"] = sumo.SUMO_HOME


@contextlib.contextmanager
def standard_error() -> Iterator[Any]:
    """Capture the process's standard error, that of C++ included; yields a function that returns its text."""
    with tempfile.TemporaryFile() as file:
        saved = os.dup(2)
        os.dup2(file.fileno(), 2)

        def words() -> str:
            file.seek(0)
            return file.read().decode("utf-8", "replace")

        try:
            yield words
        finally:
            os.dup2(saved, 2)
            os.close(saved)


def cause(words: str, otherwise: str) -> str:
    """SUMO's errors in its output `words`, in one line, without warnings; `otherwise` where it has none."""
    found = re.findall(r"^Error: (.*(?:\n (?! *Error:| *Warning:).*)*)", words, flags=re.MULTILINE)
    found = [one_line(text) for text in found if not text.startswith("Quitting")]
    return "; ".join(dict.fromkeys(found)) or one_line(words) or one_line(otherwise)


def one_line(text: str) -> str:
    """The text without line breaks, control characters escaped: SUMO's messages quote names from files."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in " ".join(text.split()))


def is_left_hand(net_file: Path) -> bool:
    """Whether traffic keeps left according to the network file; False where it cannot be read."""
    try:
        return root_element(net_file)[1].get("lefthand", "") in ("1", "true")
    except (OSError, EOFError, zlib.error, XmlInputError):
        return False
