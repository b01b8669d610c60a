"""Every reader of user input as a function of bytes, for the fuzzers and the tests.

A reader must either accept its input or raise one of its own errors, with a message that a user can read. Any
other error, or more time than `limit_s`, is a finding.
"""

import contextlib
import time
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from analysis.footage import FootageError
from analysis.radar_log import LogError
from sumo_net.road import NetworkError
from sumo_net.settings import SettingsError

REFUSALS = (SettingsError, NetworkError, LogError, FootageError)


class Reader(NamedTuple):
    """A reader, and how to make inputs for it."""

    name: str
    suffix: str
    read: Callable[[Path], object]
    seeds: tuple[bytes, ...]  # valid inputs, from which others are made
    words: tuple[bytes, ...]  # of its language: keys, difficult values
    limit_s: float = 5.0  # of process time
    mended: Callable[[bytes], bytes] = bytes  # corrects the checksums


class Outcome(NamedTuple):
    """Result of a reader for one input."""

    finding: str  # '' if there is none
    taken: bool


def attempt(reader: Reader, content: bytes, folder: Path) -> Outcome:
    """Read `content` as a file in `folder`."""
    file = folder / f"input{reader.suffix}"
    _write(file, content)
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader.read(file)
        finding, taken = "", True
    except REFUSALS as refusal:
        finding, taken = _unreadable(str(refusal)), False
    except Exception as error:
        finding, taken = f"{type(error).__name__}: {str(error)[:300]}", False
    spent = time.process_time() - began
    if not finding and spent > reader.limit_s:
        finding = f"took {spent:.1f} s"
    return Outcome(finding, taken)


def _write(file: Path, content: bytes) -> None:
    """Write a new file: some file systems write a truncated and refilled one to disk at once."""
    file.unlink(missing_ok=True)
    file.write_bytes(content)


def _unreadable(message: str) -> str:
    if not message.strip():
        return "refused without a message"
    if any(not (letter.isprintable() or letter == "\n") for letter in message):
        return f"a message with control characters: {message[:300]!r}"
    if len(message) > 20_000:
        return f"a message of {len(message)} characters"
    return ""


# --- what is read


def _scenario(file: Path) -> object:
    from plugin.configuration import load_configuration

    return load_configuration(str(file)).hash


def _campaign(file: Path) -> object:
    from analysis.campaign.plan import load

    return load(file).hash


def _camera(file: Path) -> object:
    from camera_synth.camera import projection
    from plugin.configuration import read_camera

    return projection(read_camera(file))


def _expectations(file: Path) -> object:
    from analysis.regression import expectations

    return expectations(file)


def _protocol(file: Path) -> object:
    from analysis.protocol.definition import load

    return load(str(file))


def _log(name: str) -> Callable[[Path], object]:
    def read(file: Path) -> object:
        from analysis.radar_formats import load

        return load(file, name)

    return read


def _comma(file: Path) -> object:
    """Three tables in one input, separated by a line `---`."""
    from analysis.radar_formats import load

    for name, part in zip(("radar", "speed", "gyro"), file.read_bytes().split(b"\n---\n"), strict=False):
        _write(file.parent / f"{name}.csv", part)
    return load(file.parent, "comma2k19")


def _image(file: Path) -> object:
    from analysis.footage import frames, open_footage

    return [one.size_px for one in frames(open_footage(file))]


def _network(file: Path) -> object:
    from sumo_net.road import RoadNetwork

    roads = RoadNetwork.from_net_file(file)
    for edge in roads.drivable_edges()[:4]:
        for lane in roads.graph.edges[edge].lanes[:2]:
            roads.path(lane, (edge,))
    return roads


def _additional(file: Path) -> object:
    from sumo_net.configuration import without_outputs

    _write(file.parent / "other.add.xml", b"<additional/>")
    made = Path(without_outputs(file, file.parent / "work"))
    if made != file and file.parent / "work" not in made.parents:
        raise AssertionError(f"wrote {made}")
    return made


_NET = b"""<net version="1.20"><location netOffset="0.00,0.00" convBoundary="0,0,200,0"/>
<edge id=":b_0" function="internal">
<lane id=":b_0_0" index="0" speed="13.9" length="5.00" shape="98,0 103,0"/></edge>
<edge id="a" from="x" to="b"><lane id="a_0" index="0" speed="13.9" length="98.00" shape="0,0 98.00,0.00"/>
<lane id="a_1" index="1" speed="13.9" width="2.50" length="98.00" disallow="tram"
shape="0,3.20 98.00,3.20"/></edge>
<edge id="c" from="b" to="y">
<lane id="c_0" index="0" speed="13.9" length="97" shape="103,0 150,4,1.5 200,20"/></edge>
<connection from="a" to="c" fromLane="0" toLane="0" via=":b_0_0" dir="s" state="M"/>
<connection from=":b_0" to="c" fromLane="0" toLane="0" dir="s" state="M"/></net>"""
_ADDITIONAL = b"""<additional><inductionLoop id="e1" lane="a_0" pos="10" period="60" file="out/../loop.xml"/>
<include href="other.add.xml"/><edgeData id="d" file="/tmp/edge.xml" period="60"/>
<vType id="t"><param key="device.ssm.file" value="../ssm.xml"/></vType>
<poly id="p" imgFile="x.png"/></additional>"""
_SCENARIO = b"""title = "My road"
duration_s = 30.0
seed = 4
mode = "refined"
[condition]
preset = "complex"
noise_grey = 10.0
[equipment]
fraction = 0.3
ids = ["a", "b"]
[driver]
distraction_per_min = 3.0
[departure]
threshold_s = 1.2
[highway]
lanes = 2
elements = [{kind = "straight", length_m = 600.0}, {kind = "arc", length_m = 200.0, radius_m = 400.0}]
[[actors]]
id = "ego"
position_m = 50.0
speed_mps = 20.0
equipped = true
[[script]]
who = "ego"
at_s = 2.0
do = "veer"
drift_mps = 0.5
for_s = 2.0
[collision.distance]
model = "berkeley"
"""
_CAMPAIGN = b"""title = "c"
scenarios = ["highway", "curves"]
seeds = {first = 1, count = 3}
duration_s = 20.0
keep = ["steps"]
[settings]
"equipment.fraction" = 0.1
[grid]
"departure.threshold_s" = [0.5, 1.0]
condition = ["clear", "night"]
[random]
"condition.noise_grey" = {distribution = "uniform", low = 1.0, high = 9.0}
"""
_CAMERA = b"""[camera]
height_m = 1.3
focal_px = 900.0
pitch_rad = 0.04
"""
_EXPECT = b"""title = "x"
scenario = "straight"
seeds = [1, 2]
[settings]
duration_s = 20.0
[expect]
departures.missed = 0
detection_rate = {min = 0.9, max = 1.0}
[golden]
figures = ["departures.missed"]
tolerance = 0.1
"""
_CSV = (
    b"time_s,range_m,range_rate_mps,azimuth_rad,target_id,ego_speed_mps,true_range_m\n"
    b"0.0,100.0,-5.0,0.01,a,20,100\n0.1,99.5,-5.0,0.01,a,20,99\n0.1,50,0,-0.2,b,20,50\n0.2,,,,,20,\n"
)
_UDACITY = b"""L 0.312 0.58 1477010443000000 0.6 0.6 5.2 0 0 0.007
R 1.0148 0.5542 4.8928 1477010443050000 0.86 0.6 5.2 0.003 0.001 0.03
R 1.0475 0.3892 4.5110 1477010443150000 1.1 0.6 5.2 0.01 0.005 0.05
"""
_COMMA = b"""time_s,address,forward_m,left_m,relative_speed_mps,new_track
0.0,528,50.0,1.0,-2.0,1
0.05,528,49.9,1.0,-2.0,0
0.05,529,80.0,-3.0,1.0,1
---
time_s,speed_mps
0.0,20.0
0.01,20.1
0.05,20.2
---
time_s,gyro_x_radps,gyro_y_radps,gyro_z_radps
0.0,0,0,0.01
0.01,0,0,0.01
"""

_NUMBERS = (
    b"0 -1 1 1e308 -1e308 1e-320 nan inf -inf 9223372036854775808 0x7f 1_0 1e400 0.1 999999999 true".split()
)
_TEXTS = (
    b"../../etc/passwd",
    b"/",
    b"a\\u0000b",
    b"<script>alert(1)</script>",
    "✗é𝔘\u202e".encode(),
    b"\xff\xfe",
    b"\x00",
    b"\x1b[31m",
    b"\r\n",
    b"A" * 5000,
    b"'\"",
)
_TOML = (
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b",",
    b"[[x]]",
    b'"""',
    b"1979-05-27T07:32:00Z",
    b"[" * 2000,
    b"{a=" * 800,
)
_XML = (b"<", b">", b"/>", b'"', b"&amp;", b"&a;", b'<!DOCTYPE net [<!ENTITY a "b">]>', b"<![CDATA[", b"<!--")
_XML += (b'<include href="input.add.xml"/>', b'shape=""', b'shape="0,0 0,0"', b'lefthand="true"', b'id=""')

READERS: dict[str, Reader] = {
    reader.name: reader
    for reader in (
        Reader("scenario", ".toml", _scenario, (_SCENARIO,), (*_TOML, *_NUMBERS, *_TEXTS)),
        # 100,000 runs are allowed, and checking each takes half a millisecond
        Reader("campaign", ".toml", _campaign, (_CAMPAIGN,), (*_TOML, *_NUMBERS, *_TEXTS), limit_s=60.0),
        Reader("camera", ".toml", _camera, (_CAMERA,), (*_TOML, *_NUMBERS, *_TEXTS)),
        Reader("expect", ".scenario.toml", _expectations, (_EXPECT,), (*_TOML, *_NUMBERS, *_TEXTS)),
        Reader("radar_csv", ".csv", _log("csv"), (_CSV,), (b",", b"\n", b'"', *_NUMBERS, *_TEXTS)),
        Reader("udacity", ".txt", _log("udacity"), (_UDACITY,), (b" ", b"\n", b"R ", *_NUMBERS, *_TEXTS)),
        Reader("comma2k19", ".csv", _comma, (_COMMA,), (b",", b"\n", b"\n---\n", *_NUMBERS, *_TEXTS)),
        Reader("network", ".net.xml", _network, (_NET,), (*_XML, *_NUMBERS, *_TEXTS)),
        Reader("additional", ".add.xml", _additional, (_ADDITIONAL,), (*_XML, *_NUMBERS, *_TEXTS)),
    )
}


def pictures(suffix: str) -> bytes:
    """A small valid picture."""
    import cv2
    import numpy as np

    grey = (np.add.outer(np.arange(24), np.arange(32)) * 4).astype(np.uint8)
    return bytes(cv2.imencode(suffix, np.dstack([grey] * 3))[1])


def png_mended(content: bytes) -> bytes:
    """A PNG with correct checksums, as far as its chunks can be parsed."""
    out, at = bytearray(content), 8
    while at + 12 <= len(out):
        end = at + 8 + int.from_bytes(out[at : at + 4], "big")
        if end + 4 > len(out):
            break
        out[end : end + 4] = zlib.crc32(out[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return bytes(out)


def film(folder: Path) -> bytes:
    """A small valid video."""
    import cv2
    import numpy as np

    file = folder / "seed.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (32, 24))
    for k in range(3):
        writer.write(np.full((24, 32, 3), 40 * k, np.uint8))
    writer.release()
    with contextlib.closing(file.open("rb")) as made:
        return made.read()


def with_media(folder: Path) -> dict[str, Reader]:
    """READERS, the protocol files, and the pictures and videos, whose seeds must be made first."""
    from analysis.protocol import definition

    own = [
        file.read_bytes() for file in sorted((Path(definition.__file__).parent / "standards").glob("*.toml"))
    ]
    more = [Reader("protocol", ".toml", _protocol, tuple(own), (*_TOML, *_NUMBERS, *_TEXTS))]
    for suffix in (".png", ".jpg", ".bmp", ".tiff"):
        reader = Reader(f"image_{suffix[1:]}", suffix, _image, (pictures(suffix),), _BINARY)
        more.append(reader._replace(mended=png_mended) if suffix == ".png" else reader)
    more.append(Reader("video", ".avi", _image, (film(folder),), _BINARY))
    return READERS | {reader.name: reader for reader in more}


_BINARY = (
    b"\x00\x00\x00\x00",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\x00\x01",
    b"IDAT",
    b"RIFF",
    b"00dc",
)
