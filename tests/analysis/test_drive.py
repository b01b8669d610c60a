"""Recorded drives: frames kept while running, and made afterwards by repeating the run."""

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import av
import cv2
import numpy as np
import pandas as pd
import pytest

from analysis import canvas
from analysis.cli import main
from analysis.drive import DriveError, load_drive, most_interesting, vehicles_of, vehicles_with_frames
from analysis.replay import replay
from analysis.video import make_video
from camera_synth.camera import PROCESSED_FROM, projection, vehicle_from_image
from plugin.capture import FRAMES, folder_name
from plugin.configuration import load_configuration
from plugin.record import read_table
from sumo_net.settings import SettingsError
from tests.processes import in_process

SECONDS = 5.0


class Runs(NamedTuple):
    """A run that kept frames; the same without them, and those of two of its vehicles made afterwards."""

    watched: Path
    repeated: Path
    name: str
    changed: str  # a vehicle whose recorded rows were altered
    findings: list[str]


def run_and_repeat(folder: Path) -> Runs:
    """Both in one process, to load the kernels once; also records the frames given to the detector."""
    from analysis.simulate import simulate
    from plugin.vision import Vision

    given: dict[str, list[Any]] = {}
    look = Vision._look

    def spied(self: Vision, frames: Any, state: Any, *rest: Any) -> Any:
        for frame, key in zip(frames, state.camera_key.tolist(), strict=True):
            given.setdefault(str(key), []).append(frame.copy())
        return look(self, frames, state, *rest)

    watched, repeated = folder / "watched", folder / "repeated"
    Vision._look = spied  # type: ignore[method-assign]
    simulate("highway", watched, quiet=True, duration_s=SECONDS, fraction=0.05, seed=3, frames=3, threads=1)
    Vision._look = look  # type: ignore[method-assign]
    np.savez(folder / "seen.npz", **{key: np.stack(frames) for key, frames in given.items()})

    shutil.copytree(watched, repeated, ignore=shutil.ignore_patterns(FRAMES))
    name = load_drive(watched).vehicle_id
    changed = next(other for other in vehicles_with_frames(watched) if other != name)
    steps = pd.read_csv(repeated / "steps.csv", dtype={"fcw_track_id": "Int64"})
    steps.loc[steps.index[steps["vehicle_id"] == changed][1], "speed_mps"] += 0.01
    steps.to_csv(repeated / "steps.csv", index=False)
    return Runs(watched, repeated, name, changed, replay(repeated, [name, changed], threads=1))


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    done: Runs = in_process(run_and_repeat, tmp_path_factory.mktemp("drive"))
    return done


@pytest.fixture
def watched(runs: Runs) -> Path:
    return runs.watched


def test_a_frame_and_a_row_a_step(watched: Path) -> None:
    assert len(vehicles_with_frames(watched)) == 3
    drive = load_drive(watched)
    count = len(drive.time_s)
    assert drive.frames.shape == (count, 240, 320)
    assert drive.frames.dtype == np.uint8
    assert len(drive.steps) == count
    assert drive.steps["time_s"].to_numpy() == pytest.approx(drive.time_s)
    assert count >= 40
    assert set(drive.steps["vehicle_id"]) == set(drive.tracks["vehicle_id"]) == {drive.vehicle_id}
    assert drive.path_m.shape == (count, 30, 2)
    assert drive.border_px.shape == (count, 2, len(drive.border_rows))
    assert drive.notes == ()


def test_the_frames_are_the_detectors_in_the_rows_that_it_looks_at(watched: Path) -> None:
    drive = load_drive(watched)
    with np.load(watched.parent / "seen.npz") as seen:
        given = [seen[key][:, PROCESSED_FROM:] for key in seen.files]
    assert any(np.array_equal(frames, drive.frames[:, PROCESSED_FROM:]) for frames in given)
    assert drive.frames[:, :PROCESSED_FROM].std() > 1.0  # and above them there is a sky


def test_borders_lie_on_the_painted_lines_and_the_path_where_the_vehicle_goes(watched: Path) -> None:
    drive = load_drive(watched)
    seen_by = projection(drive.camera)
    distance = []
    for i in np.flatnonzero(drive.steps["recognised"].fillna(False).to_numpy(bool)):
        for column in drive.border_px[i]:
            for y, x in list(zip(drive.border_rows, column, strict=True))[10:35:5]:
                if 0.0 < x < 319.0:
                    forward, left = vehicle_from_image(float(x), float(y), seen_by)
                    lines = [
                        np.interp(forward, *line.T) for line in drive.road_m[i] if np.isfinite(line).all()
                    ]
                    distance.append(min(abs(left - line) for line in lines))
    assert len(distance) > 100
    assert np.percentile(distance, 95) < 0.25
    forward = drive.path_m[:, 4, 0]
    known = np.isfinite(forward)
    assert forward[known] == pytest.approx(0.5 * drive.steps["speed_mps"].to_numpy()[known], rel=0.1)


def test_tracks_lie_on_the_bodies(watched: Path) -> None:
    drive = load_drive(watched)
    tracks = drive.tracks[drive.tracks["measured"] & drive.tracks["in_path"]]
    assert len(tracks) > 20
    bodies = dict(zip(np.round(drive.time_s, 2), drive.bodies_m, strict=True))
    for track in tracks.itertuples():
        forward, left, _, length, width = bodies[round(track.time_s, 2)].T
        outside = np.maximum(np.abs(track.x_m - forward) - length / 2, np.abs(track.y_m - left) - width / 2)
        assert np.nanmin(outside) < 2.0


def test_repeating_the_run_gives_the_same_bytes(runs: Runs) -> None:
    again, first = load_drive(runs.repeated), load_drive(runs.watched, runs.name)
    assert again.vehicle_id == first.vehicle_id
    assert np.array_equal(again.frames, first.frames)
    assert np.array_equal(again.path_m, first.path_m, equal_nan=True)
    assert np.array_equal(again.bodies_m, first.bodies_m, equal_nan=True)
    assert again.tracks.equals(first.tracks)
    assert again.notes == ()


def test_a_repeated_run_that_is_another_one_is_told(runs: Runs) -> None:
    (finding,) = runs.findings
    assert runs.changed in finding
    assert "differs from" in finding
    assert "(speed_mps)" in finding
    notes = load_drive(runs.repeated, runs.changed).notes
    assert notes == (finding.split(" (recorded with")[0],)


def test_settings_beside_the_tables_are_those_of_the_run(watched: Path) -> None:
    configuration = load_configuration(str(watched / "configuration.json"))
    assert configuration.hash == read_table(watched, "runs")["configuration_hash"][0]
    assert configuration.recording.frames == 3


def test_an_earlier_runs_frames_go_and_a_users_files_stay(watched: Path, tmp_path: Path) -> None:
    from plugin.capture import clear

    shutil.copytree(watched / FRAMES, tmp_path / FRAMES)
    (tmp_path / FRAMES / "mine").mkdir()
    clear(tmp_path / FRAMES)
    assert [file.name for file in (tmp_path / FRAMES).iterdir()] == ["mine"]


@pytest.mark.parametrize("name", ["../../etc", "a/b\n", "", ".", "Ünïcödé 車", "x" * 400, "con:nul"])
def test_folders_are_safe_for_any_id(name: str) -> None:
    folder = folder_name(name)
    assert Path(folder).name == folder
    assert folder.isascii()
    assert len(folder) < 80
    assert not folder.startswith(".")


def test_folders_of_different_ids_differ() -> None:
    assert len({folder_name(name) for name in ("a/b", "a_b", "a b", "A_b")}) == 4


def test_what_is_missing_is_said(watched: Path, tmp_path: Path) -> None:
    with pytest.raises(DriveError, match="holds no table 'steps'"):
        load_drive(tmp_path)
    name = vehicles_of(watched)[0]
    with pytest.raises(DriveError, match="did you mean"):
        load_drive(watched, name[:-1] + "x")
    shutil.copytree(watched, tmp_path / "run", ignore=shutil.ignore_patterns(FRAMES))
    with pytest.raises(DriveError, match="holds no frames"):
        load_drive(tmp_path / "run")
    with pytest.raises(DriveError, match=f"no frames of '{name}'"):
        load_drive(tmp_path / "run", name)
    assert most_interesting(watched) in vehicles_of(watched)
    said: list[str] = []
    with pytest.raises(DriveError, match="has no step in that time"):
        make_video(tmp_path / "run", tmp_path / "drive.mp4", name, begin_s=1e6, tell=said.append)
    assert not said  # the run is not repeated for nothing
    settings = tmp_path / "run" / "configuration.json"
    content = json.loads(settings.read_text(encoding="utf-8"))
    settings.write_text(json.dumps(content | {"scenario": ""}), encoding="utf-8")  # of a user's own loop
    with pytest.raises(SettingsError, match="loop of your own"):
        load_configuration(str(settings))
    told: list[str] = []
    with pytest.raises(DriveError, match="loop of your own"):
        make_video(tmp_path / "run", tmp_path / "drive.mp4", name, tell=told.append)
    assert not told
    settings.unlink()
    with pytest.raises(DriveError, match="cannot be repeated"):
        replay(tmp_path / "run", [name])


def decoded(file: Path) -> tuple[str, str, float, list[np.ndarray]]:
    """Codec, pixel format, frames a second, and the pictures, BGR."""
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        pictures = [frame.to_ndarray(format="bgr24") for frame in container.decode(stream)]
        context = stream.codec_context
        return context.name, str(context.pix_fmt), float(stream.average_rate or 0), pictures


def typed(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    said = capsys.readouterr()
    return int(left.value.code or 0), said.out, said.err


@pytest.mark.parametrize(("suffix", "codec"), [(".mp4", "h264"), (".webm", "vp9")])
def test_video_is_what_browsers_play_and_shows_every_step(
    suffix: str, codec: str, watched: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = load_drive(watched)
    file = tmp_path / "deep" / f"seen{suffix}"
    begin = drive.time_s[5]
    words = ("--vehicle", drive.vehicle_id, "--from", f"{begin}", "--to", f"{begin + 0.9}", "--out", file)
    status, out, err = typed(capsys, "video", watched, *words)
    assert (status, err) == (0, "")
    assert out == f"{drive.vehicle_id}: {file}\n"
    name, pixels, rate, pictures = decoded(file)
    assert (name, pixels, rate, len(pictures)) == (codec, "yuv420p", 10.0, 10)
    assert pictures[0].shape == (720, 1280, 3)
    # the sky comes from the camera image: its brightness survives the coding
    sky = drive.frames[5][10:60, 160:300].mean()
    assert pictures[0][26:156, 416:780].mean() == pytest.approx(sky, abs=4.0)


def test_a_still_has_border_and_path_where_they_were_found(
    watched: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = load_drive(watched)
    shown = int(np.flatnonzero(drive.steps["recognised"].fillna(False).to_numpy(bool))[-1])
    file = tmp_path / "seen.png"
    words = ("--vehicle", drive.vehicle_id, "--from", f"{drive.time_s[shown]}", "--out", file)
    assert typed(capsys, "video", watched, *words)[0] == 0
    picture = cv2.imread(str(file))
    assert picture is not None
    scale = 832 / 320
    hits = total = 0
    for columns, colour in zip(drive.border_px[shown], (canvas.LEFT, canvas.RIGHT), strict=True):
        for y, x in zip(drive.border_rows[:40], columns, strict=False):
            if 3.0 < x < 316.0 and abs(x - 160.0) > 12.0:
                column, row = round((x + 0.5) * scale), round((239.5 - y) * scale)
                near = picture[row, column - 2 : column + 3].astype(int)
                hits += bool((np.abs(near - colour).sum(axis=1) < 30).any())
                total += 1
    assert total > 20
    assert hits > 0.9 * total


def test_video_says_what_is_wrong(watched: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = load_drive(watched).vehicle_id
    (tmp_path / "file").write_text("")
    for words, expected in (
        (("--vehicle", name[:-1] + "x"), "did you mean"),
        (("--out", tmp_path / "a.xyz"), "its suffix must be one of .mp4"),
        (("--out", tmp_path / "file" / "a.mp4"), "cannot be made"),
        (("--vehicle", name, "--from", "9999", "--out", tmp_path / "a.mp4"), "it drove from"),
        (("--vehicle", name, "--from", "nan", "--out", tmp_path / "a.mp4"), "must be a time"),
    ):
        status, out, err = typed(capsys, "video", watched, *words)
        assert (status, out) == (2, "")
        assert err.startswith("error: ")
        assert err.count("\n") == 1
        assert expected in err
    status, _, err = typed(capsys, "video", tmp_path)
    assert status == 2
    assert "holds no table 'steps'" in err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file"]


def test_text_of_any_id_can_be_drawn() -> None:
    picture = np.zeros((40, 200, 3), np.uint8)
    for words in ("", "\n\x00", "Ünïcödé 車", "x" * 300):
        canvas.text(picture, words, 190.0, 38.0)
        canvas.text(picture, words, -50.0, -3.0, back=canvas.DARK)
    assert picture.any()


def test_report_shows_the_drive_on_its_road(watched: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from analysis.report.run_page import run_page

    monkeypatch.setattr("analysis.report.run_page._cards", lambda run: [])
    page = run_page(watched)
    assert page.notes == []
    assert [drive["vehicle"] for drive in page.drives] == vehicles_with_frames(watched)
    assert page.settings.startswith("{")
    scene = page.scene
    assert isinstance(scene, dict)
    lanes = np.array([(x, y) for x, y in zip(*scene["outline"].values(), strict=True) if x is not None])
    for path in scene["paths"]:
        place = np.array([(x, y) for x, y in zip(path["x"], path["y"], strict=True) if x is not None])
        apart = np.hypot(*(place[:, None] - lanes).T).min(axis=0)
        assert apart.min() < 20.0  # in the same place as the network


def test_positions_and_lane_width_are_recorded(watched: Path) -> None:
    steps = read_table(watched, "steps")
    assert steps["true_lane_width_m"].between(2.5, 5.0).all()
    for _, rows in steps.groupby("vehicle_id"):
        driven = np.hypot(rows["true_x_m"].diff(), rows["true_y_m"].diff()).iloc[1:]
        assert driven.to_numpy() == pytest.approx(0.1 * rows["speed_mps"].iloc[1:].to_numpy(), abs=0.2)
