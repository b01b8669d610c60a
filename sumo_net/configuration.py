"""Prepares a user's SUMO configuration for a run that writes only into the run's directory.

SUMO itself reads the configuration and writes it out with full option names and absolute paths. Every option
that names an output is then redirected into the run's directory. So is every output that an additional file
names (detectors, edge data): that file is copied with the names changed.
"""

import re
import subprocess
import xml.etree.ElementTree as ET
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sumo_net.settings import SettingsError
from sumo_net.xml_input import is_packed, read_bounded, root_element

_OUTPUT_OPTIONS = (
    "netstate-dump",
    "log",
    "message-log",
    "error-log",
    "save-state.prefix",
    "save-state.files",
    "device.ssm.file",
    "device.toc.file",
    "pedestrian.jupedsim.wkt",
    "pedestrian.jupedsim.py",
)
_DROPPED_OPTIONS = ("output-prefix", "save-configuration", "save-template", "save-schema", "remote-port")
_INPUT_OPTIONS = ("net-file", "route-files", "additional-files", "weight-files", "load-state")

# Elements of additional files that write a file, and the attribute that names it.
_WRITING = {
    **dict.fromkeys(("e1Detector", "inductionLoop", "instantInductionLoop"), "file"),
    **dict.fromkeys(("e2Detector", "laneAreaDetector", "e3Detector", "entryExitDetector"), "file"),
    **dict.fromkeys(("routeProbe", "vTypeProbe", "edgeData", "laneData", "meanData"), "file"),
    "calibrator": "output",
    "timedEvent": "dest",
}
# <param> keys of vehicles and vehicle types; "file" also of traffic lights, for their detectors.
_WRITING_PARAMETERS = ("device.ssm.file", "device.toc.file", "file")
# Attributes that name a file to read, relative to the file that contains them.
_READING = {
    "include": "href",
    "rerouter": "file",
    "calibrator": "file",
    "variableSpeedSign": "file",
    "poly": "imgFile",
    "poi": "imgFile",
    "vType": "imgFile",
}
_MAY_WRITE = re.compile(
    "|".join(
        [*(rf"<{tag}\b" for tag in _WRITING), "<include", *(rf"[\"']{p}[\"']" for p in _WRITING_PARAMETERS)]
    ).encode()
)
_PLAIN = re.compile(rb"(\xef\xbb\xbf)?\s*<")  # ASCII-compatible encoding: tags can be searched as bytes
_DEEPEST_INCLUDE = 20
_NOWHERE = re.compile(r"(?i)(nul|none|/dev/null|[\w.-]+:\d+)$")


@dataclass(frozen=True, slots=True)
class Configuration:
    """A prepared configuration: its file in the run's directory, and notes for the user."""

    file: Path
    net_file: Path
    begin_s: float
    notes: tuple[str, ...]


def prepare_configuration(
    source: Path, directory: Path, overrides: Mapping[str, str], length_s: float
) -> Configuration:
    """Write `directory`/run.sumocfg from the user's `source`, with `overrides` (option: value) applied.

    It ends `length_s` after the time at which the user's begins.

    Raises SettingsError where SUMO cannot read the configuration (with SUMO's message) or a file that it
    names is missing.
    """
    directory.mkdir(parents=True, exist_ok=True)
    options = read_configuration(source, directory)
    if not options.get("net-file"):
        raise SettingsError(f"{source}: names no network (net-file)")
    _need_inputs(options, source)
    try:
        begin = seconds(options.get("begin", "0"))
    except ValueError:
        raise SettingsError(f"{source}: begin = '{options['begin']}': is not a time") from None
    overrides = {**overrides, "end": f"{begin + length_s:.10g}"}
    notes = [
        f"{source.name}: {name} {options[name]} is overridden by {value}"
        for name, value in overrides.items()
        if options.get(name) and not _same(options[name], value) and name != "no-step-log"
    ]
    for name in _INPUT_OPTIONS:
        for path in _paths(options[name]) if options.get(name) and name != "load-state" else ():
            _root(Path(path))
    directory = directory.resolve()
    for name, value in list(options.items()):
        if name in _DROPPED_OPTIONS:
            del options[name]
        elif writes(name) and value:
            options[name] = ",".join(_redirected(part, directory) for part in value.split(","))
    copies = _Copies(directory)
    for name in ("net-file", "additional-files", "route-files"):
        if options.get(name):
            options[name] = ",".join(copies.without_outputs(Path(p)) for p in _paths(options[name]))
    options |= overrides
    file = directory / "run.sumocfg"
    root = ET.Element("configuration")
    for name, value in options.items():
        ET.SubElement(root, name, value=value)
    ET.indent(root)
    ET.ElementTree(root).write(file, encoding="UTF-8", xml_declaration=True)
    return Configuration(file, Path(options["net-file"]), begin, tuple(notes))


def read_configuration(source: Path, directory: Path) -> dict[str, str]:
    """The options that a .sumocfg sets, with full names and absolute paths, as SUMO itself reads them."""
    import sumo  # the wheel that contains the program

    if not source.is_file():
        raise SettingsError(f"{source}: no such file")
    _root(source)
    if is_packed(source):
        raise SettingsError(
            f"{source}: is compressed, as SUMO reads networks and routes, but no configuration: gunzip it"
        )
    program = next(iter(sorted((Path(sumo.SUMO_HOME) / "bin").glob("sumo*"))), None)
    if program is None:
        raise SettingsError(f"no sumo in {sumo.SUMO_HOME}/bin: pip install eclipse-sumo")
    read = directory / "as_read.sumocfg"
    command = [str(program), "-c", str(source.resolve()), "--save-configuration", str(read)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not read.is_file():
        said = [line.removeprefix("Error:").strip() for line in done.stderr.splitlines()]
        words = " ".join(line for line in said if line and not line.startswith("Quitting"))
        raise SettingsError(f"{source}: SUMO cannot read it: {words or f'exit {done.returncode}'}")
    root = ET.parse(read).getroot()
    read.unlink()
    return {option.tag: option.get("value", "") for section in root for option in section}


def writes(option: str) -> bool:
    """Whether the value of an option of SUMO's names files that it writes."""
    return option.endswith("-output") or option in _OUTPUT_OPTIONS


def seconds(text: str) -> float:
    """A time as SUMO writes it: seconds, or [days:]hours:minutes:seconds."""
    total, parts = 0.0, [float(part) for part in text.split(":")]
    for part, unit in zip(reversed(parts), (1.0, 60.0, 3600.0, 86400.0), strict=False):
        total += part * unit
    return total


def without_outputs(path: Path, directory: Path) -> str:
    """The path itself where an XML file names no output, else that of a copy with outputs in `directory`.

    Raises SettingsError: not XML, XML entities, more than 1 GiB, includes that recur or are too deep.
    """
    directory.mkdir(parents=True, exist_ok=True)
    return _Copies(directory.resolve()).without_outputs(path)


class _Copies:
    """Copies of files that name outputs, in a directory, with the names changed."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._made = 0
        self._within: list[Path] = []  # the chain of includes being read

    def without_outputs(self, path: Path) -> str:
        """The path itself where the file names no output, else that of a changed copy."""
        real = path.resolve()
        if real in self._within or len(self._within) >= _DEEPEST_INCLUDE:
            raise SettingsError(f"{path}: is included by itself, or more than {_DEEPEST_INCLUDE} deep")
        _root(path)
        try:
            text = read_bounded(path)
        except (OSError, EOFError, zlib.error) as error:
            raise SettingsError(f"{path}: cannot be read ({error})") from None
        if _PLAIN.match(text) and not _MAY_WRITE.search(text):
            return str(path)
        try:
            root = ET.fromstring(text)
        except (ET.ParseError, ValueError) as error:  # ValueError: a multi-byte encoding
            raise SettingsError(f"{path}: is not valid XML: {error}") from None
        self._within.append(real)
        for element in root.iter():
            self._change(element, path.parent)
        self._within.pop()
        self._made += 1
        copy = self._directory / f"{self._made}_{path.name.removesuffix('.gz')}"
        ET.ElementTree(root).write(copy, encoding="UTF-8", xml_declaration=True)
        return str(copy)

    def _change(self, element: ET.Element, home: Path) -> None:
        reads, writes = _READING.get(element.tag), _WRITING.get(element.tag)
        if reads and element.get(reads):
            named = home / element.attrib[reads]
            element.set(reads, self.without_outputs(named) if element.tag == "include" else str(named))
        if writes and element.get(writes):
            element.set(writes, _redirected(element.attrib[writes], self._directory))
        if element.tag == "param" and element.get("key") in _WRITING_PARAMETERS:
            element.set("value", _redirected(element.get("value", ""), self._directory))


def _redirected(path: str, directory: Path) -> str:
    name = path.strip().replace("\\", "/").rstrip("/")
    return name if not name or _NOWHERE.fullmatch(name) else str(directory / name.rsplit("/", 1)[-1])


def _need_inputs(options: Mapping[str, str], source: Path) -> None:
    for name in _INPUT_OPTIONS:
        for path in _paths(options.get(name, "")):
            if not Path(path).is_file():
                raise SettingsError(f"{source}: {name} names {path}: no such file")


def _paths(value: str) -> list[str]:
    return [part.strip() for part in value.split(",") if part.strip()]


def _same(one: str, other: str) -> bool:
    try:
        return float(one) == float(other)
    except ValueError:
        return one == other


def _root(path: Path) -> None:
    """Refuse XML entities before SUMO reads the file."""
    try:
        root_element(path)
    except (OSError, EOFError, zlib.error) as error:
        raise SettingsError(f"{path}: cannot be read ({error})") from None
