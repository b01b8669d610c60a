"""Faults during a run: results are kept, tables are complete, the message says what happened."""

import os
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from plugin.record import read_table
from plugin.schema import TABLES
from tests.processes import in_process

SHORT = {
    "duration_s": 3.0,
    "fraction": 0.05,
    "seed": 4,
    "changes": {"warm_up_s": 0.5, "recording": {"roadside_every": 1}},
}


def often() -> None:
    """Write the tables every second instead of every ten, to shorten the tests."""
    import plugin.assistance

    plugin.assistance.SETTLE_EVERY_STEPS = 10


def plain(out: Path, options: dict[str, Any]) -> None:
    from analysis.simulate import simulate

    often()
    simulate("straight", out, quiet=True, threads=1, **options)


def clock_steps(out: Path, options: dict[str, Any]) -> None:
    """The wall clock jumps by hours, back and forth, whenever it is read."""
    generator, true = np.random.default_rng(1), time.time
    time.time = lambda: true() + float(generator.uniform(-1e5, 1e5))
    plain(out, options)


def reversed_lists(out: Path, options: dict[str, Any]) -> None:
    """SUMO names its vehicles in another order."""
    import libsumo

    names = libsumo.vehicle.getIDList
    libsumo.vehicle.getIDList = lambda: names()[::-1]
    plain(out, options)


def full_disk(out: Path, options: dict[str, Any], most_bytes: int) -> None:
    """From the first step on, no file can grow beyond `most_bytes`."""
    from sumo_net.traffic import Traffic

    step = Traffic.step

    def limited(self: Traffic) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))
        step(self)

    Traffic.step = limited  # type: ignore[method-assign]
    plain(out, options)


def vanishing(out: Path, options: dict[str, Any]) -> list[str]:
    """Vehicles vanish between the reading of the traffic and its processing."""
    import libsumo

    from sumo_net.traffic import Traffic

    snapshot, gone = Traffic.snapshot, []

    def and_remove(self: Traffic) -> Any:
        made = snapshot(self)
        if round(self.time_s * 10) % 4 == 0:
            names = sorted(libsumo.vehicle.getIDList())
            for name in (names[0], names[len(names) // 2]):
                libsumo.vehicle.remove(name)
                gone.append(name)
        return made

    Traffic.snapshot = and_remove  # type: ignore[method-assign]
    plain(out, options)
    return gone


def broken_demand(out: Path) -> str:
    """SUMO reads vehicles when they are due, and later finds one whose road does not exist."""
    from analysis.simulate import settings_of
    from plugin.assistance import DriverAssistance
    from sumo_net.scenario import prepare
    from sumo_net.traffic import Traffic, TrafficError

    often()
    configuration = settings_of("straight", **SHORT)
    prepared = prepare(configuration, out)
    late = out / "late.rou.xml"
    late.write_text(
        '<routes><vehicle id="good" depart="2.0"><route edges="forward_0"/></vehicle>'
        '<vehicle id="lost" depart="2.5"><route edges="nowhere"/></vehicle></routes>',
        encoding="utf-8",
    )
    words = list(prepared.arguments)
    at = words.index("--route-files") + 1
    words[at] = f"{words[at]},{late}"
    try:
        with (
            Traffic.start([*words, "--route-steps", "1"]) as traffic,
            DriverAssistance(traffic, configuration, prepared.network, out=out / "run", threads=1) as adas,
        ):
            for _ in range(60):
                traffic.step()
                adas.step()
    except TrafficError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed")
    in_process(plain, out, SHORT | {"formats": ("csv", "parquet")})
    assert len(read_table(out, "steps")) > 50
    return out


@pytest.mark.parametrize("fault", [clock_steps, reversed_lists])
def test_what_must_not_matter_changes_no_byte(undisturbed: Path, tmp_path: Path, fault: Any) -> None:
    in_process(fault, tmp_path, SHORT)
    for name in TABLES:
        assert (tmp_path / f"{name}.csv").read_bytes() == (undisturbed / f"{name}.csv").read_bytes(), name


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_disk_that_is_full_in_mid_run(undisturbed: Path, tmp_path: Path, form: str) -> None:
    size = (undisturbed / f"steps.{form}").stat().st_size
    with pytest.raises(OSError, match=r"cannot be written .*File too large.*earlier rows") as error:
        in_process(full_disk, tmp_path, SHORT | {"formats": (form,)}, int(0.7 * size))
    assert str(tmp_path) in str(error.value)
    whole = pd.DataFrame(read_table(undisturbed, "steps"))
    kept = read_table(tmp_path, "steps")
    assert len(kept) > 0
    pd.testing.assert_frame_equal(kept, whole.iloc[: len(kept)])
    assert kept["time_s"].max() >= 1.0
    for name in TABLES:
        read_table(tmp_path, name)


def test_vehicles_that_vanish_in_mid_step(tmp_path: Path) -> None:
    gone = in_process(vanishing, tmp_path, SHORT | {"fraction": 0.5, "duration_s": 2.0})
    steps = read_table(tmp_path, "steps")
    assert set(gone) & set(steps["vehicle_id"])
    assert not steps.duplicated(["vehicle_id", "time_s"]).any()
    assert len(read_table(tmp_path, "runs")) == 1


def test_an_error_of_sumo_in_mid_run_is_told_and_the_rows_are_kept(tmp_path: Path) -> None:
    said = in_process(broken_demand, tmp_path)
    assert "SUMO stopped" in said
    assert "nowhere" in said
    steps = read_table(tmp_path / "run", "steps")
    assert steps["time_s"].max() > 1.0
    assert read_table(tmp_path / "run", "runs")["end_s"].iloc[0] == steps["time_s"].max()


def as_nobody(out: Path) -> None:
    from plugin.record import Recorder

    if os.geteuid() == 0:  # root ignores permissions
        os.setuid(65534)
    Recorder("r", out / "deep", ("csv",)).close()


def test_a_read_only_folder_is_named() -> None:
    with tempfile.TemporaryDirectory() as folder:  # pytest's own folders are accessible to its user only
        os.chmod(folder, 0o555)
        with pytest.raises(PermissionError, match=r"Permission denied.*deep"):
            in_process(as_nobody, Path(folder))
        os.chmod(folder, 0o755)
        assert not list(Path(folder).iterdir())


def test_an_interrupted_installation_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from analysis import cli

    def broken(*_: object, **__: object) -> None:
        raise ModuleNotFoundError("No module named 'filterpy'", name="filterpy")

    monkeypatch.setattr(cli, "app", broken)
    with pytest.raises(SystemExit) as left:
        cli.main(["run"])
    assert left.value.code == 2
    said = capsys.readouterr().err
    assert "filterpy" in said
    assert "pip install" in said
