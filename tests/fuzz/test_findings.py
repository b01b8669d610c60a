"""Regression tests for findings of hostile input: bombs, loops, paths out of the directory."""

import gzip
import os
import struct
import time
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from analysis import footage
from analysis.campaign import plan
from analysis.footage import FootageError, frames, open_footage, read_picture
from analysis.radar_formats import load
from analysis.radar_log import LogError
from benchmarks.fuzz_readers import READERS, film
from plugin.configuration import load_configuration, read_camera
from sumo_net import lane_graph, xml_input
from sumo_net.configuration import prepare_configuration, without_outputs
from sumo_net.demand import read_net
from sumo_net.settings import SettingsError, read_json, read_toml
from sumo_net.start_up import is_left_hand

NET = READERS["network"].seeds[0]
BOMB = b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "ha">%s]>' % b"".join(
    b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(12)
)


@pytest.fixture
def soon() -> Iterator[None]:
    """Refused at once, not after it has been unpacked."""
    began = time.process_time()
    yield
    assert time.process_time() - began < 2.0


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("kind", ["toml", "json"])
@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"a":' * 50_000, ".".join("a" * 3000) + "=1", "a=" + "9" * 9999]
)
def test_depth_and_length_of_settings(tmp_path: Path, kind: str, text: str) -> None:
    file = tmp_path / f"deep.{kind}"
    file.write_text(text if kind == "toml" or text[0] != "[" else '{"a":' + text)
    with pytest.raises(SettingsError, match=r"deep\.(toml|json)"):
        (read_toml if kind == "toml" else read_json)(file)


def test_a_scenario_that_is_based_on_itself(tmp_path: Path) -> None:
    (tmp_path / "a.scenario.toml").write_text('scenario = "b.scenario.toml"')
    (tmp_path / "b.scenario.toml").write_text('scenario = "a.scenario.toml"')
    with pytest.raises(SettingsError, match="is based on itself"):
        load_configuration(str(tmp_path / "a.scenario.toml"))


@pytest.mark.parametrize("text", ["camera = 1.0", "camera = [1]", "camera = 'x'", "camera = 1979-05-27"])
def test_a_camera_that_is_no_table(tmp_path: Path, text: str) -> None:
    (tmp_path / "camera.toml").write_text(text)
    with pytest.raises(SettingsError, match="must be a table of settings"):
        read_camera(tmp_path / "camera.toml")


def test_a_message_is_no_longer_than_one_can_read(tmp_path: Path) -> None:
    many = "\n".join(f"k{k} = 1" for k in range(500))
    for text in (f'duration_s = "{"A" * 100_000}"', many, f'"{"B" * 100_000}" = 1'):
        (tmp_path / "a.toml").write_text(text)
        with pytest.raises(SettingsError) as refused:
            load_configuration(str(tmp_path / "a.toml"))
        assert len(str(refused.value)) < 10_000


def test_a_date_in_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text('seeds = [1]\n[grid]\n"condition.noise_grey" = [1979-05-27, 1.0]\n')
    with pytest.raises(SettingsError, match="noise_grey"):
        plan.load(tmp_path / "c.toml")


def test_no_message_can_steer_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('"dur\\u001b[31mation" = 1\n[script]\n')
    with pytest.raises(SettingsError, match=r"dur\\x1b") as refused:
        load_configuration(str(tmp_path / "a.toml"))
    assert str(refused.value).replace("\n", "").isprintable()
    (tmp_path / "a.net.xml").write_bytes(NET.replace(b'"a_0"', b'"a_\x7f"').replace(b"98.00,0.00", b"1e9,0"))
    with pytest.raises(lane_graph.NetworkError) as mistaken:
        lane_graph.read(tmp_path / "a.net.xml")
    assert str(mistaken.value).isprintable()


def test_a_path_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('net_file = "a\\u0000b"')
    with pytest.raises(SettingsError, match=r"net_file = 'a\\x00b': is not a file name"):
        load_configuration(str(tmp_path / "a.toml"))


def test_a_draw_between_nought_and_minus_nought(tmp_path: Path) -> None:
    file = tmp_path / "c.toml"
    file.write_text(
        'scenarios = ["highway"]\nseeds = {first = 1, count = 1}\n[random]\n'
        '"condition.noise_grey" = {distribution = "uniform", low = 0, high = -0.0}\n'
    )
    assert plan.load(file).runs[0].changes["condition"] == {"noise_grey": 0.0}


@pytest.mark.usefixtures("soon")
def test_a_campaign_of_more_runs_than_anyone_can_make(tmp_path: Path) -> None:
    grid = "\n".join(f'"driver.distraction_per_min{k}" = [1, 2, 3, 4, 5, 6, 7, 8, 9]' for k in range(20))
    (tmp_path / "c.toml").write_text(f"seeds = [1]\n[grid]\n{grid}\n")
    with pytest.raises(SettingsError, match="runs: at most 100000"):
        plan.load(tmp_path / "c.toml")
    (tmp_path / "c.toml").write_text("seeds = {first = 1, count = 100001}")
    with pytest.raises(SettingsError, match="asks for 100001 runs"):
        plan.load(tmp_path / "c.toml")


# --- XML: SUMO's own parser would expand a bomb, so it must be refused before


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("which", ["sumocfg", "net", "routes", "additional"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_xml_bombs_are_refused_before_sumo_sees_them(tmp_path: Path, which: str, encoding: str) -> None:
    content = {
        "sumocfg": b'<configuration><net-file value="a.net.xml"/><route-files value="a.rou.xml"/>'
        b'<additional-files value="a.add.xml"/></configuration>',
        "net": NET,
        "routes": b"<routes/>",
        "additional": b"<additional/>",
    }
    content[which] = (BOMB + content[which]).decode().encode(encoding)
    for name, suffix in (
        ("sumocfg", "sumocfg"),
        ("net", "net.xml"),
        ("routes", "rou.xml"),
        ("additional", "add.xml"),
    ):
        (tmp_path / f"a.{suffix}").write_bytes(content[name])
    with pytest.raises(SettingsError, match="declares the XML entity 'a'"):
        prepare_configuration(tmp_path / "a.sumocfg", tmp_path / "work", {}, 1.0)
    if which == "net":
        for read in (read_net, lane_graph.read):
            with pytest.raises(ValueError, match="declares the XML entity"):
                read(tmp_path / "a.net.xml")


@pytest.mark.usefixtures("soon")
def test_packed_files_that_unpack_to_more_than_fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a.add.xml.gz"
    file.write_bytes(gzip.compress(b"<additional>" + b" " * 10_000_000))
    monkeypatch.setattr(xml_input.read_bounded, "__defaults__", (1_000_000,))
    with pytest.raises(SettingsError, match="larger than 1000000 bytes"):
        without_outputs(file, tmp_path / "work")
    with gzip.open(file) as packed, pytest.raises(SettingsError, match="larger than 1000000 bytes"):
        list(iter(partial(xml_input.Bounded(packed, file, 1_000_000).read, 65536), b""))
    file.write_bytes(gzip.compress(b" " * 10_000_000 + b"<additional/>"))
    with pytest.raises(SettingsError, match="no root element"):
        without_outputs(file, tmp_path / "work")


def test_an_include_of_itself_and_outputs_that_hide(tmp_path: Path) -> None:
    loop = tmp_path / "loop.add.xml"
    loop.write_text('<additional><include href="loop.add.xml"/></additional>')
    with pytest.raises(SettingsError, match="is included by itself"):
        without_outputs(loop, tmp_path / "work")
    hidden = tmp_path / "hidden.add.xml"
    text = (
        '<?xml version="1.0" encoding="utf-16"?><additional><e1Detector id="a" file="../../x"/></additional>'
    )
    hidden.write_bytes(text.encode("utf-16"))
    light = tmp_path / "light.add.xml"
    light.write_text(
        '<additional><tlLogic id="j"><param key="file" value="/tmp/x.xml"/></tlLogic></additional>'
    )
    for file in (hidden, light):
        copy = Path(without_outputs(file, tmp_path / "work"))
        assert copy.parent == tmp_path / "work"
        assert f'"{tmp_path}/work/x' in copy.read_text()


# --- networks


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("end", ["1e9,0", "98.00,1e300", "400000,0"])
def test_a_lane_of_a_million_kilometres(tmp_path: Path, end: str) -> None:
    file = tmp_path / "a.net.xml"
    file.write_bytes(NET.replace(b"98.00,0.00", end.encode()))
    with pytest.raises(lane_graph.NetworkError, match="lane 'a_0' has a shape of"):
        lane_graph.read(file)


def test_which_side_traffic_keeps_to_is_asked_of_the_root_alone(tmp_path: Path) -> None:
    file = tmp_path / "a.net.xml"
    for text, left in (
        (b"<!-- <net lefthand='1'> -->" + NET, False),
        (NET.replace(b"<net ", b"<net\n  lefthand='true' "), True),
        (b"nothing", False),
    ):
        file.write_bytes(text)
        assert is_left_hand(file) is left


# --- logs


def test_the_tables_of_comma2k19_are_checked(tmp_path: Path) -> None:
    content = READERS["comma2k19"].seeds[0]
    for old, new, says in (
        (b"address,", b"adress,", r"radar.csv:1: column address is missing"),
        (b"0.05,528", b"0.05,x", r"radar.csv:3: address = 'x' must be a finite number"),
        (b"20.1", b"nan", r"speed.csv:3: speed_mps = 'nan' must be"),
        (b"0.01,20.1\n0.05,20.2\n", b"", r"speed.csv: holds fewer than two rows"),
        (b"0.0,0,0,0.01\n0.01,0,0,0.01\n", b"", r"gyro.csv: holds no rows"),
    ):
        for name, part in zip(
            ("radar", "speed", "gyro"), content.replace(old, new).split(b"\n---\n"), strict=True
        ):
            (tmp_path / f"{name}.csv").write_bytes(part)
        with pytest.raises(LogError, match=says):
            load(tmp_path, "comma2k19")


def test_a_column_cannot_write_to_the_terminal(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_bytes(READERS["radar_csv"].seeds[0].replace(b"true_range_m", b"true_\x1b[2Jrange_m"))
    with pytest.raises(LogError, match="unknown") as refused:
        load(file)
    assert str(refused.value).isprintable()


# --- pictures


def png(width: int, height: int) -> bytes:
    """A PNG that declares a size, but has no pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b""))
        + chunk(b"IEND", b"")
    )


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("size", [(12_000, 12_000), (30_000, 30_000), (2**31 - 1, 2**31 - 1), (10**8 + 1, 1)])
def test_picture_bombs(tmp_path: Path, size: tuple[int, int]) -> None:
    file = tmp_path / "a.png"
    file.write_bytes(png(*size))
    with pytest.raises(FootageError, match="more than 100000000 pixels"):
        read_picture(file)


def test_a_picture_that_is_a_pipe_or_broken(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "a.png")
    with pytest.raises(FootageError, match="is not a file"):
        list(frames(open_footage(tmp_path / "a.png")))
    os.mkfifo(tmp_path / "a.mp4")
    with pytest.raises(FootageError, match="is not a file"):
        open_footage(tmp_path / "a.mp4")
    (tmp_path / "b.png").write_bytes(png(32, 24))
    with pytest.raises(FootageError, match=r"can(not)? be read"):
        read_picture(tmp_path / "b.png")
    assert capfd.readouterr().err == ""  # the decoder's own words would make it more than one line


def test_a_video_of_giants(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.avi").write_bytes(film(tmp_path))
    assert np.shape(next(frames(open_footage(tmp_path / "a.avi"))).picture) == (24, 32, 3)
    monkeypatch.setattr(footage, "MOST_PIXELS", 700)
    with pytest.raises(FootageError, match="more than 700 pixels"):
        open_footage(tmp_path / "a.avi")
