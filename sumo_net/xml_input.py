"""XML from outside: entities are refused and sizes limited before it is read here or by SUMO.

SUMO's own parser expands entities without limit, so a file of a kilobyte can fill the memory. Entities can
only be declared before the root element: reading that far is enough, whatever the file's size.
"""

import gzip
import io
from pathlib import Path
from xml.parsers import expat

from sumo_net.settings import SettingsError

MOST_BYTES = 2**30  # of an unpacked file
_PROLOGUE_BYTES = 2**20  # limit of what precedes the root element
_PIECE_BYTES = 4096


class XmlInputError(SettingsError):
    """A file that is refused; the message names it."""


class _Found(Exception):  # noqa: N818 - it ends the parsing, nothing is wrong
    """The root element begins: parsing can stop."""


def is_packed(file: Path) -> bool:
    """Whether a file is gzip by its first bytes. Raises OSError."""
    with file.open("rb") as raw:
        return raw.read(2) == b"\x1f\x8b"


def root_element(file: Path) -> tuple[str, dict[str, str]]:
    """Tag and attributes of an XML file's root (plain or gzip); ("", {}) where there is none.

    Raises XmlInputError where the file declares entities or has no root within _PROLOGUE_BYTES. Malformed XML
    is left to the reader of the whole file. Raises OSError, EOFError, zlib.error where it cannot be read.
    """
    parser = expat.ParserCreate()
    found: list[tuple[str, dict[str, str]]] = []

    def begins(tag: str, given: dict[str, str]) -> None:
        found.append((tag, given))
        raise _Found

    def declares(name: str, *_: object) -> None:
        raise XmlInputError(f"{file}: declares the XML entity {name!r}: not accepted")

    parser.StartElementHandler = begins
    parser.EntityDeclHandler = declares
    with gzip.open(file) if is_packed(file) else file.open("rb") as text:
        try:
            for _ in range(0, _PROLOGUE_BYTES, _PIECE_BYTES):
                piece = text.read(_PIECE_BYTES)
                parser.Parse(piece, not piece)
                if not piece:
                    return "", {}
        except _Found:
            return found[0]
        except expat.ExpatError:
            return "", {}
    raise XmlInputError(f"{file}: no root element within {_PROLOGUE_BYTES} bytes")


def read_bounded(file: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """A file's bytes, unpacked where it is gzip.

    Raises XmlInputError above `most_bytes`; OSError, EOFError, zlib.error where it cannot be read.
    """
    with gzip.open(file) if is_packed(file) else file.open("rb") as text:
        content = text.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise XmlInputError(f"{file}: is larger than {most_bytes} bytes unpacked: not accepted")
    return content


class Bounded(io.RawIOBase):
    """A stream of at most `most_bytes`, for parsers that read in pieces."""

    def __init__(self, stream: io.BufferedIOBase, file: Path, most_bytes: int = MOST_BYTES) -> None:
        self._stream, self._file, self._left = stream, file, most_bytes
        self._most = most_bytes

    def read(self, size: int = -1) -> bytes:
        """Read up to `size` bytes. Raises XmlInputError once more than `most_bytes` have been read."""
        piece = self._stream.read(size)
        self._left -= len(piece)
        if self._left < 0:
            raise XmlInputError(f"{self._file}: is larger than {self._most} bytes unpacked: not accepted")
        return piece
