"""Campaigns: checked completely before they run, nothing lost, the same report whatever happens."""

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.campaign import tally as counting
from analysis.campaign.growth import contains, continued, described
from analysis.campaign.plan import Campaign, Draw, Plan, Seeds, in_words, load, plan
from analysis.campaign.report import write_report
from analysis.campaign.store import Store
from analysis.cli import main
from sumo_net.settings import SettingsError

COMMAND = [sys.executable, "-c", "from analysis.cli import main; main()", "batch"]
SMALL = """title = "Small"
scenarios = ["straight"]
seeds = [3, 4]
duration_s = 3.0
settings = { "equipment.fraction" = 0.05, warm_up_s = 1.0 }
grid = { condition = ["clear", "night"] }
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "campaign.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_plan_is_every_cell_with_every_seed() -> None:
    made = plan(
        Campaign(
            scenarios=("straight", "curves"),
            seeds=Seeds(first=5, count=3),
            grid={"condition": ("clear", "complex"), "departure.threshold_s": (0.8, 1.2)},
            random={"driver.distraction_per_min": Draw(low=0.5, high=3.0)},
        )
    )
    assert (len(made.cells), len(made.runs)) == (8, 24)
    assert len({run.key for run in made.runs}) == 24
    drawn = {run.seed: set() for run in made.runs}
    for run in made.runs:
        drawn[run.seed].add(run.changes["driver"]["distraction_per_min"])
    assert all(len(values) == 1 for values in drawn.values())  # the same for one seed in all cells
    assert len(set.union(*drawn.values())) == 3
    assert "departure.threshold_s = 0.8" in in_words(made.runs[0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seeds = [1]\ngrid = { condition = [] }", "name at least one value"),
        ("seeds = [1, 2, 1]", "given twice"),
        ("seeds = []", "name at least one"),
        ('seeds = [1]\nsettings = { "departure.treshold_s" = 1.0 }', "threshold_s"),
        ('seeds = [1]\ngrid = { "departure.threshold_s" = [1.0, -1.0] }', "threshold_s"),
        ('seeds = [1]\nscenarios = ["hihgway"]', "highway"),
        ('seeds = [1]\nkeep = ["step"]', "steps"),
        ("seeds = [1]\ngrid = { seed = [1, 2] }", "seed"),
        ("seeds = [1]\nworker = 3", "worker"),
        ("", r"^[^\n]*campaign.toml: seeds: is missing \(a list, or first and count\)$"),
        ('seeds = "1-5"', r"^[^\n]*campaign.toml: seeds = '1-5': must be a list$"),
        ("seeds = { first = 1, count = 0 }", r"^[^\n]*campaign.toml: seeds.count = 0: [^\n]*greater than 0$"),
        ("seeds = [1.5]", r"^[^\n]*campaign.toml: seeds.0 = 1.5: [^\n]*integer[^\n]*$"),
        ('seeds = [1]\nrandom = { warm_up_s = { distribution = "uniform" } }', "low and high"),
    ],
)
def test_what_is_wrong_is_said_before_anything_runs(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        load(written(tmp_path, text))


def test_a_wrong_value_is_the_campaigns_and_not_its_scenarios(tmp_path: Path) -> None:
    file = written(tmp_path, 'scenarios = ["straight"]\nseeds = [1]\ngrid = { condition = ["smog"] }')
    with pytest.raises(SettingsError) as error:
        load(file)
    assert str(error.value).startswith(
        f"{file}: straight with condition = 'smog': condition.preset = 'smog': known"
    )
    (tmp_path / "mine.toml").write_text("duration_s = -1.0")
    with pytest.raises(SettingsError, match=r"mine.toml: duration_s = -1"):
        load(written(tmp_path, 'scenarios = ["mine.toml"]\nseeds = [1]'))


def test_a_dry_run_lists_the_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(["batch", str(written(tmp_path, SMALL)), "--out", str(tmp_path / "out"), "--dry-run"])
    assert done.value.code in (0, None)
    said = capsys.readouterr().out
    assert said.count("condition.preset = night") == 2
    assert "4 runs in 2 cells, 0 done" in said
    assert not (tmp_path / "out").exists()


def test_a_dry_run_says_what_is_done(tmp_path: Path, whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def dry(text: str) -> str:
        with pytest.raises(SystemExit):
            main(["batch", str(written(tmp_path, text)), "--out", str(whole), "--dry-run"])
        said = capsys.readouterr()
        return said.out + said.err

    assert "4 runs in 2 cells, 4 done" in dry(SMALL)
    said = dry(SMALL.replace("[3, 4]", "[3, 4, 5]"))
    assert said.count("(done)") == 4
    assert "6 runs in 2 cells, 4 done" in said
    assert "2 to run, 0.00 h simulated" in said
    assert "holds another campaign" in dry(SMALL.replace("0.05", "0.06"))


@given(st.lists(st.dictionaries(st.sampled_from("abcdef"), st.integers(0, 1000)), max_size=8), st.randoms())
def test_counts_add_up_in_any_order(parts: list[dict[str, int]], random: object) -> None:
    one, other = {}, {}
    for part in parts:
        counting.add(one, part)
    random.shuffle(parts)  # type: ignore[attr-defined]
    for part in parts:
        counting.add(other, part)
    assert (
        one
        == other
        == dict(sum((Counter(part) for part in parts), Counter())) | {k: 0 for k in one if not one[k]}
    )


@given(st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=200), st.sampled_from([0.05, 0.5, 0.95]))
def test_quantiles_of_bins_are_those_of_the_values(values: list[float], q: float) -> None:
    counts = counting._errors("e", pd.Series(values))
    exact = np.quantile(values, q, method="inverted_cdf")
    assert exact <= counting.quantile(counts, "e", q) * (1 + 1e-5)
    assert counting.quantile(counts, "e", q) <= exact * 10.0 ** (1 / counting.PER_DECADE) * (1 + 1e-5)


def test_unknown_errors_count_as_infinite_and_missing_ones_not_at_all() -> None:
    counts = counting._errors("e", pd.Series([0.1, np.inf, np.nan]))
    assert sum(counts.values()) == 2
    assert counting.quantile(counts, "e", 1.0) == np.inf


def test_a_directory_belongs_to_one_campaign(tmp_path: Path) -> None:
    store = Store(tmp_path / "out")
    store.claim("A", "1" * 64, 3)
    store.claim("A", "1" * 64, 3)
    with pytest.raises(SettingsError, match="another campaign"):
        store.claim("B", "2" * 64, 3)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").touch()
    with pytest.raises(SettingsError, match="not empty"):
        Store(tmp_path / "mine").claim("A", "1" * 64, 3)


def test_a_campaign_may_grow_and_keeps_its_runs(tmp_path: Path) -> None:
    """Seeds, values of a grid, scenarios: cells keep their numbers, new ones come after them."""
    small = plan(Campaign(seeds=(3, 4), grid={"condition": ("clear", "night"), "reaction.on": (False, True)}))
    before = json.loads(json.dumps(described(small, False)))

    def grown(**changes: object) -> Plan:
        given = {"seeds": (3, 4), "grid": small.campaign.grid} | changes
        return continued(plan(Campaign(**given)), before)  # type: ignore[arg-type]

    assert grown().hash == small.hash
    more = small.campaign.grid | {"condition": ("clear", "rain", "night")}
    larger = grown(seeds=(2, 3, 4), grid=more, scenarios=("highway", "curves"))
    assert contains(described(larger, False), before)
    assert [cell["condition"] for cell in larger.cells[:5]] == ["clear", "clear", "night", "night", "rain"]
    assert len({one.key for one in larger.runs}) == len(larger.runs) == 36
    assert all(
        one.changes["condition"]["preset"] == larger.cells[one.cell]["condition"] for one in larger.runs
    )
    again = json.loads(json.dumps(described(larger, False)))
    assert continued(larger, again).hash == larger.hash
    assert not contains(described(grown(seeds=(3,)), False), before)
    assert not contains(described(grown(settings={"warm_up_s": 1.0}), False), before)
    assert not contains(described(grown(keep=("steps",)), False), before)
    assert not contains(described(larger, True), before)


@pytest.mark.parametrize("address", ["file", "memory"])
def test_a_run_is_there_whole_or_not_at_all(tmp_path: Path, address: str) -> None:
    store = Store(f"memory://{tmp_path.name}" if address == "memory" else tmp_path / "out")
    store.claim("A", "1" * 64, 2)
    place = tmp_path / "run"
    place.mkdir()
    (place / "summary.json").write_text('{"key": "k"}')
    (place / "steps.parquet").write_bytes(b"x")
    store.put("0000-1", place)
    store.put("0000-1", place)  # a second time is harmless
    assert store.done() == {"0000-1"}
    assert [summary["key"] for summary in store.summaries()] == ["k"]
    store.fail("0000-2", "why", 2)
    assert store.failures()["0000-2"]["cause"] == "why"
    store.put("0000-2", place)
    assert store.failures() == {}


def test_a_full_disk_is_told_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path / "out")
    full = lambda *_, **__: Path("/dev/full").open("w")  # noqa: E731, SIM115
    monkeypatch.setattr(store._fs, "open", full)
    with pytest.raises(OSError, match=r"No space left on device: '.*/out/rates.csv'"):
        store.write_text("rates.csv", "text")


def test_a_directory_is_refused_where_anything_that_matters_has_changed(tmp_path: Path) -> None:
    base = tmp_path / "mine.toml"
    base.write_text("duration_s = 3.0\n")
    text = 'scenarios = ["mine.toml"]\nseeds = [1]\n'
    first = load(written(tmp_path, text)).hash
    assert load(written(tmp_path, text)).hash == first
    assert load(written(tmp_path, text), keep=("steps",)).hash != first
    assert load(written(tmp_path, text + "settings = { warm_up_s = 1.0 }")).hash != first
    base.write_text("duration_s = 3.0\nequipment.fraction = 0.3\n")  # the file behind the campaign's own
    assert load(written(tmp_path, text)).hash != first


@pytest.mark.parametrize("name", ["a.sumocfg", "a.cfg.xml"])
def test_a_directory_is_refused_where_a_file_that_sumo_reads_has_changed(tmp_path: Path, name: str) -> None:
    net = tmp_path / "a.net.xml"
    net.write_text("<net/>")
    (tmp_path / name).write_text(
        "<configuration><input><net-file value='a.net.xml'/></input><output><summary value='s.xml'/></output>"
        "<tripinfo-output value='t.xml'/></configuration>"
    )
    (tmp_path / "mine.toml").write_text(f"configuration = '{name}'")
    text = 'scenarios = ["mine.toml"]\nseeds = [1]\n'
    first = load(written(tmp_path, text)).hash
    for output in ("s.xml", "t.xml"):  # as SUMO by itself writes beside the configuration
        (tmp_path / output).write_text("<written/>")
    assert load(written(tmp_path, text)).hash == first
    net.write_text("<net version='1'/>")
    assert load(written(tmp_path, text)).hash != first


def test_a_worker_that_cannot_run_is_named_before_anything_is_written(tmp_path: Path) -> None:
    """A scheduler and workers in this process, with other versions than the client."""
    from unittest import mock

    from distributed import LocalCluster

    from analysis.campaign import engine

    made = load(written(tmp_path, SMALL))
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster:
        with (
            mock.patch.object(engine, "versions", return_value="sumo-adas 9.9"),
            pytest.raises(
                SettingsError, match=r"worker .* has python .*, here is sumo-adas 9.9: install the same"
            ),
        ):
            engine.run(made, tmp_path / "out", scheduler=cluster.scheduler_address)
        cluster.scale(0)
        cluster.sync(cluster._correct_state)
        with pytest.raises(SettingsError, match="has no workers"):
            engine.run(made, tmp_path / "out", scheduler=cluster.scheduler_address)
    assert not (tmp_path / "out").exists()


def batch(file: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, str(file), "--out", str(out), "--workers", "2", *more],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of the campaign SMALL, run without interruption."""
    folder = tmp_path_factory.mktemp("campaign")
    done = batch(written(folder, SMALL), folder / "whole", "--keep", "")
    _, words = done.communicate(timeout=240)
    assert done.returncode == 0, words
    return folder / "whole"


def test_killed_and_resumed_it_gives_the_same_report_byte_for_byte(tmp_path: Path, whole: Path) -> None:
    file, broken = written(tmp_path, SMALL), tmp_path / "broken"
    first = batch(file, broken)
    begin = time.monotonic()
    while not list(broken.glob("runs/*/summary.json")) and time.monotonic() - begin < 120:
        time.sleep(0.2)
    os.killpg(first.pid, signal.SIGKILL)
    first.communicate()
    assert len(list(broken.glob("runs/*/summary.json"))) < 4
    done = batch(file, broken, "--workers", "1")
    _, words = done.communicate(timeout=240)
    assert done.returncode == 0, words
    names = sorted(path.name for path in whole.glob("*.csv"))
    assert "rates.csv" in names
    for name in names:
        assert (broken / name).read_bytes() == (whole / name).read_bytes(), name
    tables = write_report(whole)
    assert tables["runs"]["run"].tolist() == [f"{c:04d}-{s:010d}" for c in (0, 1) for s in (3, 4)]
    counted = json.loads((whole / "runs" / "0000-0000000003" / "summary.json").read_text())["counts"]
    assert counted["vehicle_steps"] > 0


def test_more_seeds_run_only_what_is_missing(tmp_path: Path, whole: Path) -> None:
    out = tmp_path / "out"
    batch(written(tmp_path, SMALL.replace("[3, 4]", "[4]")), out).communicate()
    first = {file: file.stat().st_mtime_ns for file in out.glob("runs/*/summary.json")}
    assert len(first) == 2
    batch(written(tmp_path, SMALL), out).communicate()
    assert {file: file.stat().st_mtime_ns for file in first} == first
    for table in whole.glob("*.csv"):
        assert (out / table.name).read_bytes() == table.read_bytes(), table.name


def test_a_run_that_fails_is_recorded_and_stops_no_other(tmp_path: Path) -> None:
    net = tmp_path / "broken.sumocfg"
    net.write_text("<configuration><input><net-file value='missing.net.xml'/></input></configuration>")
    good = SMALL.replace('["straight"]', '["straight", "broken.sumocfg"]').replace("[3, 4]", "[3]")
    text = good.replace('grid = { condition = ["clear", "night"] }', "retries = 1")
    done = batch(written(tmp_path, text), tmp_path / "out")
    said, words = done.communicate(timeout=240)
    assert done.returncode == 1
    assert "0001-0000000003 (2 attempts)" in words
    failures = pd.read_csv(tmp_path / "out" / "failures.csv")
    assert failures["run"].tolist() == ["0001-0000000003"]
    assert "missing.net.xml" in failures["cause"].iloc[0]
    assert "1 runs" in said


def test_an_unreachable_scheduler_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    done = batch(written(tmp_path, SMALL), tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9")
    _, words = done.communicate(timeout=60)
    assert done.returncode == 2
    assert words.strip().count("\n") == 0
    assert "no scheduler answers" in words
    assert not (tmp_path / "out").exists()
