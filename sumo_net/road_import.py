"""SUMO networks from OpenStreetMap extracts and OpenDRIVE files."""

import zlib
from pathlib import Path
from typing import NamedTuple

from sumo_net.netconvert import BuildError, netconvert
from sumo_net.settings import SettingsError
from sumo_net.xml_input import root_element


class Format(NamedTuple):
    """A road format that netconvert reads."""

    name: str
    endings: tuple[str, ...]
    root: str  # root element of the file
    option: str  # netconvert's option for the file
    options: tuple[str, ...]
    types: str = ""  # of roads or lanes, for netconvert; its own where empty


# as SUMO's web wizard, but without U-turns on the spot, which no car can drive, except at dead ends, and with
# isolated roads
_OSM = (
    "--keep-edges.by-vclass=passenger",
    "--geometry.remove=true",
    "--ramps.guess=true",
    "--junctions.join=true",
    "--tls.guess-signals=true",
    "--tls.discard-simple=true",
    "--tls.join=true",
    "--no-turnarounds.except-deadend=true",
)
# bends as they are given: chords of 1 m, of an arc of 50 m radius 2.5 mm beside it
_OPENDRIVE = (
    "--opendrive.curve-resolution=1",
    "--keep-edges.by-vclass=passenger",
    "--no-turnarounds=true",
)
# Every lane is kept: what lies beside one that is left out would move into its place.
_CARS = (
    "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional",
    "mwyEntry", "mwyExit",
)  # fmt: skip
_NOT_DRIVEN = {  # who may use it
    "emergency": ("stop", "parking", "restricted", "roadWorks"),  # stop: a hard shoulder
    "bus": ("bus",),
    "taxi": ("taxi",),
    "hov": ("HOV",),
    "bicycle": ("biking",),
    "pedestrian": ("sidewalk", "walking"),
    "tram": ("tram",),
    "rail": ("rail",),
    "custom1": ("none", "shoulder", "border", "curb", "median", "special1", "special2", "special3"),
}
_LIMIT_MPS = 13.89  # where the file gives none
_LANE_TYPES = "\n".join(
    [
        "<types>",
        *(f'<type id="{name}" speed="{_LIMIT_MPS}" disallow="pedestrian rail tram ship"/>' for name in _CARS),
        *(
            f'<type id="{name}" speed="{_LIMIT_MPS}" allow="{who}"/>'
            for who, names in _NOT_DRIVEN.items()
            for name in names
        ),
        "</types>",
    ]
)
_ALL = ("--precision=4", "--flatten=true")  # 0.1 mm; the world here is flat

OSM = Format(
    name="OpenStreetMap extract",
    endings=(".osm", ".osm.xml", ".osm.gz", ".osm.xml.gz"),
    root="osm",
    option="--osm-files",
    options=_OSM,
)
OPENDRIVE = Format(
    name="OpenDRIVE file",
    endings=(".xodr", ".xodr.gz"),
    root="OpenDRIVE",
    option="--opendrive-files",
    options=_OPENDRIVE,
    types=_LANE_TYPES,
)
FORMATS = (OSM, OPENDRIVE)
ENDINGS = OSM.endings + OPENDRIVE.endings


def format_of(file: Path) -> Format | None:
    """The road format of a file by its name; None if it needs no conversion."""
    return next((one for one in FORMATS if file.name.lower().endswith(one.endings)), None)


def convert(file: Path, lefthand: bool, directory: Path) -> Path:
    """Convert a file of a known format to a SUMO network in `directory`; `lefthand`: traffic keeps left.

    Raises SettingsError for a file that is missing, of another format, or refused by netconvert.
    """
    kind = format_of(file)
    if kind is None:
        raise SettingsError(f"{file}: not a road file; known are {', '.join(ENDINGS)}")
    try:
        found, _ = root_element(file)
    except (OSError, EOFError, zlib.error) as error:
        raise SettingsError(f"{file}: cannot be read ({error})") from None
    if found != kind.root:
        told = f"begins with <{found}>" if found else "is not XML"
        raise SettingsError(f"{file}: {told}, an {kind.name} begins with <{kind.root}>")
    net_file = directory / "converted.net.xml"
    try:
        netconvert(
            net_file,
            f"{kind.option}={file}",
            f"--lefthand={str(lefthand).lower()}",
            *_types(kind, directory),
            *kind.options,
            *_ALL,
        )
    except BuildError as error:
        raise SettingsError(f"{file}: {error}") from None
    return net_file


def _types(kind: Format, directory: Path) -> tuple[str, ...]:
    if not kind.types:
        return ()
    file = directory / "types.typ.xml"
    file.write_text(kind.types, encoding="utf-8")
    return (f"--type-files={file}",)
