"""Use in a loop of the user's own: unusual arguments and names, a clock that jumps."""

import subprocess
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from plugin.record import Recorder, read_table
from plugin.schema import TABLES
from tests.processes import in_process

STRANGE_IDS = ("NaN", "null", "007", "1e5", "a/b/../c", "überStraße#1", "車")


@pytest.fixture(scope="module")
def arguments(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """SUMO arguments for a straight road with vehicles of unusual names, one per second."""
    import sumolib

    folder = tmp_path_factory.mktemp("road")
    (folder / "a.nod.xml").write_text('<nodes><node id="a" x="0" y="0"/><node id="b" x="900" y="0"/></nodes>')
    (folder / "a.edg.xml").write_text(
        '<edges><edge id="e" from="a" to="b" numLanes="2" speed="25"/></edges>', encoding="utf-8"
    )
    net = folder / "a.net.xml"
    made = [sumolib.checkBinary("netconvert"), "-n", folder / "a.nod.xml", "-e", folder / "a.edg.xml"]
    subprocess.run([*made, "-o", net], check=True, capture_output=True)
    vehicles = "".join(
        f'<vehicle id="{name}" route="r" depart="{depart}" departSpeed="20"/>'
        for depart, name in enumerate(STRANGE_IDS)
    )
    routes = folder / "a.rou.xml"
    routes.write_text(f'<routes><route id="r" edges="e"/>{vehicles}</routes>', encoding="utf-8")
    return ["-n", str(net), "-r", str(routes), "--step-length", "0.1", "--no-step-log", "--no-warnings"]


def loop(arguments: list[str], steps: int, **options: Any) -> dict[str, pd.DataFrame]:
    import libsumo

    from plugin import DriverAssistance

    libsumo.start(["sumo", *arguments])
    with DriverAssistance.attach(libsumo, equip=1.0, seed=7, threads=1, **options) as adas:
        for _ in range(steps):
            libsumo.simulationStep()
            adas.step()
    libsumo.close()
    return dict(adas.tables)


def test_out_may_be_text_and_every_name_comes_back(arguments: list[str], tmp_path: Path) -> None:
    in_memory = in_process(loop, arguments, 80)
    assert set(in_memory["steps"]["vehicle_id"]) == set(STRANGE_IDS)
    for formats in ("csv", ("parquet",), ("csv", "parquet")):
        written = in_process(_written, arguments, str(tmp_path / "out"), formats)
        for name in TABLES:
            pd.testing.assert_frame_equal(written[name], in_memory[name])
    from_csv = read_table(str(tmp_path / "out"), "steps")
    assert set(from_csv["vehicle_id"]) == set(STRANGE_IDS)


def _written(arguments: list[str], out: str, formats: Any) -> dict[str, pd.DataFrame]:
    return loop(arguments, 80, out=out, formats=formats)


def test_an_unknown_format_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    (tmp_path / "steps.csv").write_text("mine")
    with pytest.raises(ValueError, match=r"formats: .xlsx.*csv, parquet"):
        Recorder("run", tmp_path, ("csv", "xlsx"))
    with pytest.raises(ValueError, match="formats: none"):
        Recorder("run", tmp_path, ())
    assert (tmp_path / "steps.csv").read_text() == "mine"


def jumps(arguments: list[str], state: str) -> list[str]:
    """Error message if SUMO's clock does not advance by one step between two calls."""
    import libsumo

    from plugin import DriverAssistance
    from sumo_net.traffic import TrafficError

    said = []
    libsumo.start(["sumo", *arguments])
    adas = DriverAssistance.attach(libsumo, equip=1.0, seed=7, threads=1)
    for _ in range(20):
        libsumo.simulationStep()
        adas.step()
    libsumo.simulation.saveState(state)

    def try_step() -> None:
        try:
            adas.step()
        except TrafficError as error:
            said.append(str(error))

    try_step()
    libsumo.simulationStep()
    adas.step()  # nothing was lost by it
    libsumo.simulationStep()
    libsumo.simulationStep()
    try_step()
    libsumo.simulation.loadState(state)
    libsumo.simulationStep()
    try_step()
    adas.close()
    try_step()
    assert len(adas.tables["steps"]) == len(adas.tables["steps"].drop_duplicates(["vehicle_id", "time_s"]))
    with DriverAssistance.attach(libsumo, equip=1.0, seed=7, threads=1) as again:
        for _ in range(20):
            libsumo.simulationStep()
            again.step()
    assert len(again.tables["steps"]) > 40
    libsumo.close()
    return said


def test_a_clock_that_does_not_move_by_a_step_is_no_step(arguments: list[str], tmp_path: Path) -> None:
    twice, skipped, loaded, closed = in_process(jumps, arguments, str(tmp_path / "state.xml"))
    assert "2.00 to 2.00 s" in twice
    assert "after every" in twice
    assert "2.10 to 2.30 s" in skipped
    assert "2.10 to 2.10 s" in loaded
    assert "closed" in closed


def first_words(arguments: list[str]) -> str:
    """Standard error of a first start, when nothing is compiled yet."""
    import contextlib
    import io

    from plugin import assistance

    assistance.compiled = lambda: False
    with contextlib.redirect_stderr(io.StringIO()) as said:
        loop(arguments, 1)
    return said.getvalue()


def test_the_long_first_start_is_announced(arguments: list[str]) -> None:
    assert "compiling in the first steps" in in_process(first_words, arguments)


def words_of_sumo(arguments: list[str]) -> None:
    """A loop over traci in which vehicles arrive; SUMO's words go to this process's standard error."""
    import sumolib
    import traci

    from plugin import DriverAssistance

    traci.start([sumolib.checkBinary("sumo"), *arguments], stdout=subprocess.DEVNULL)
    with DriverAssistance.attach(traci, equip=1.0, seed=7, threads=1) as adas:
        while traci.simulation.getMinExpectedNumber() > 0:
            traci.simulationStep()
            adas.step()
    assert not adas.vehicles
    traci.close()


def test_a_vehicle_that_arrives_is_no_error_on_the_terminal(
    arguments: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    words_of_sumo(arguments)
    assert "rror" not in capfd.readouterr().err


def last_steps(arguments: list[str]) -> dict[str, Any]:
    """What a loop reads after each step, beside what the tables say in the end."""
    import libsumo

    from plugin import DriverAssistance

    libsumo.start(["sumo", *arguments])
    parts = []
    with DriverAssistance.attach(libsumo, equip=1.0, seed=7, threads=1) as adas:
        before = adas.last_step
        for _ in range(40):
            libsumo.simulationStep()
            adas.step()
            parts.append(adas.last_step)
        seen, nobody = adas.look("007"), adas.look("nobody")
        vehicles = adas.vehicles
    libsumo.close()
    tables = dict(adas.tables)
    return {"before": before, "parts": parts, "seen": seen, "nobody": nobody, "vehicles": vehicles} | tables


def test_the_last_step_can_be_read_in_the_loop(arguments: list[str]) -> None:
    got = in_process(last_steps, arguments)
    assert list(got["before"].columns) == list(got["steps"].columns)
    assert len(got["before"]) == 0
    assert list(got["parts"][-1]["vehicle_id"]) == got["vehicles"]
    later = ["true_tlc_s"]  # depends on what follows
    live = pd.concat(got["parts"]).drop(columns=later).sort_values(["time_s", "vehicle_id"])
    written = got["steps"].drop(columns=later).sort_values(["time_s", "vehicle_id"])
    pd.testing.assert_frame_equal(live.reset_index(drop=True), written.reset_index(drop=True))


def test_what_one_vehicle_sees_is_asked_for_by_its_id(arguments: list[str]) -> None:
    got = in_process(last_steps, arguments)
    seen = got["seen"]
    assert seen.camera.frame.shape == (240, 320)
    assert seen.step["vehicle_id"] == "007"
    assert seen.step["time_s"] == pytest.approx(4.0)
    assert set(seen.tracks["vehicle_id"]) <= {"007"}
    assert got["nobody"] is None
