"""The whole chain through its one door: a complete folder, the same bytes again, and failures that leave nothing."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import scenarios.report.page as page
import scenarios.run as door
from algorithms.method import Method
from algorithms.reconstruct import reconstruct, see
from scenarios.artefacts import write_defects
from scenarios.load import load_scenario
from scenarios.run import RunFailed, run
from scenarios.scenario import Scenario
from scenarios.score import MEANINGS
from sensor_model.recording import Recording, open_recording
from sensor_model.sense import sense

POCKET = "{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}"
SHORT = [
    "pipe.end_mm=500",
    f"pipe.features=[{POCKET}]",
    "drive.stages=[{to_mm: 120}]",
    "sensing.fidelity=points",
    "sensing.frame_rate_hz=10",
]
FEW_PICTURES = [  # on the axis, so that each ring fills its rows of the map
    *SHORT[:2],
    "drive.offset_mm=[0, 0]",
    "drive.tilt_deg=[0, 0]",
    "drive.start_mm=60",
    "drive.stages=[{to_mm: 72}]",
    "sensing.frame_rate_hz=6",
    "method.map.cell_z_mm=5",
]
FILES = {
    "scenario.yaml",
    "recording/rig.yaml",
    "recording/pipe.yaml",
    "recording/cam0/data.csv",
    "recording/imu0/data.csv",
    "recording/orientation0/data.csv",
    "recording/encoders0/data.csv",
    "truth/truth.npz",
    "truth/pipe.json",
    "reconstruction/trajectory.tum",
    "reconstruction/wall_map.npz",
    "reconstruction/cloud.ply",
    "reconstruction/wall_mesh.ply",
    "reconstruction/defects.csv",
    "reconstruction/episodes.csv",
    "score.json",
    "report.html",
    "run.json",
}
STAGES = ["drive", "sense", "reconstruct", "score", "report"]
LINES = 720
TOLD: list[tuple[str, int, int]] = []  # what the first run said of its progress


def _quiet(stage: str, done: int, total: int) -> None:
    pass


def _short(changes: list[str] = SHORT, seed: int = 0) -> Scenario:
    return load_scenario("paper-gantry", changes, seed)


def _run(scenario: Scenario, folder: Path, workers: int = 1) -> bytes:
    run(scenario, folder, workers, _quiet)
    return (folder / "score.json").read_bytes()


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "first"
    run(_short(), folder, 1, lambda *words: TOLD.append(words))
    return folder


def test_the_folder_is_complete(first):
    files = {str(file.relative_to(first)) for file in first.rglob("*") if file.is_file()}
    frames = {name for name in files if name.startswith("recording/cam0/data/")}
    assert files - frames == FILES
    named = (first / "recording" / "cam0" / "data.csv").read_text().splitlines()[1:]
    assert frames == {f"recording/cam0/data/{row.split(',')[1]}" for row in named}
    assert [file.name for file in first.parent.iterdir()] == ["first"]


def test_the_score_is_one_flat_object(first):
    row = json.loads((first / "score.json").read_text())
    assert list(row) == list(MEANINGS)
    assert all(value is None or isinstance(value, int | float) for value in row.values())
    assert (row["defects_true"], row["defects_found"], row["false_calls"]) == (1, 1, 0)
    assert row["frames"] == row["frames_registered"] == len(open_recording(first / "recording"))


def test_it_says_what_made_it(first):
    made = json.loads((first / "run.json").read_text())
    assert made["pipetwin"]
    assert {"mujoco", "numpy", "numba", "pyrender"} <= set(made["packages"])
    assert made["seed"] == 0
    assert list(made["seconds"]) == STAGES
    assert made["seconds_total"] == pytest.approx(sum(made["seconds"].values()), abs=0.01)
    assert made["peak_memory_mb"]["this_process"] > 50


def test_progress_names_every_frame(first):
    frames = len(open_recording(first / "recording"))
    assert list(dict.fromkeys(stage for stage, _, _ in TOLD)) == ["drive", "sense (points)", "reconstruct"]
    for stage in ("sense (points)", "reconstruct"):
        assert [words for words in TOLD if words[0] == stage] == [(stage, i + 1, frames) for i in range(frames)]


def _no_page(run, file: Path) -> None:
    file.write_text("")


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page takes most of the time of a short run, and has its own tests."""
    monkeypatch.setattr(page, "write_report", _no_page)


@pytest.mark.parametrize("workers", [1, 2])
def test_the_score_repeats_to_the_byte_elsewhere(first, tmp_path, workers, no_report):
    again = _run(_short(), tmp_path / "other place" / "run", workers)
    assert again == (first / "score.json").read_bytes()


def test_the_folder_s_own_scenario_repeats_the_score(first, tmp_path, no_report):
    scenario = load_scenario(str(first / "scenario.yaml"))
    assert scenario == _short()
    assert _run(scenario, tmp_path / "run") == (first / "score.json").read_bytes()


def test_another_seed_gives_another_score(first, tmp_path, no_report):
    other = json.loads(_run(_short(seed=1), tmp_path / "run"))
    row = json.loads((first / "score.json").read_text())
    assert other["center_rms_mm"] != row["center_rms_mm"]
    assert other["center_rms_mm"] == pytest.approx(row["center_rms_mm"], abs=0.05)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["seed"] == 1


def test_the_recording_alone_gives_the_same_defects(first, tmp_path):
    shutil.copytree(first / "recording", tmp_path / "recording")
    recording = open_recording(tmp_path / "recording")
    frames = (recording[index] for index in range(len(recording)))
    found = reconstruct(frames, recording.rig, recording.pipe, _short().method)
    write_defects(found.defects, tmp_path / "defects.csv")
    written = (tmp_path / "defects.csv").read_text()
    assert written == (first / "reconstruction" / "defects.csv").read_text()
    (row,) = csv.DictReader(written.splitlines())
    assert float(row["distance_mm"]) == pytest.approx(150, abs=2)


def _damaged(monkeypatch: pytest.MonkeyPatch, harm) -> None:
    """Something goes wrong with the recording between sensing and measuring."""

    def sense_and_harm(*given):
        yield from sense(*given)
        harm(next(item for item in given if isinstance(item, Path)))

    monkeypatch.setattr(door, "sense", sense_and_harm)


def _frame(recording: Path) -> Path:
    return sorted((recording / "cam0" / "data").iterdir())[4]


HARMS = {
    "a lost frame": ("reconstruct: ", lambda r: _frame(r).unlink()),
    "a frame of text": ("reconstruct: ", lambda r: _frame(r).write_text("no frame")),
    "a frame of no bytes": ("reconstruct: ", lambda r: _frame(r).write_bytes(b"")),
    "half a frame": ("reconstruct: ", lambda r: _frame(r).write_bytes(_frame(r).read_bytes()[:5000])),
    "no list of frames": ("sense: ", lambda r: (r / "cam0" / "data.csv").unlink()),
    "a broken log": ("sense: ", lambda r: (r / "imu0" / "data.csv").write_text("1,2,3,4,x,6,7\n")),
    "a broken rig": ("sense: ", lambda r: (r / "rig.yaml").write_text("camera: [")),
}


@pytest.mark.parametrize("harm", HARMS)
def test_a_recording_that_cannot_be_read_fails_by_its_stage(harm, tmp_path, monkeypatch):
    stage, act = HARMS[harm]
    _damaged(monkeypatch, act)
    with pytest.raises(RunFailed, match=f"^{stage}") as failure:
        run(_short(), tmp_path / "run", 1, _quiet)
    assert "recording" in str(failure.value)  # which file
    assert list(tmp_path.iterdir()) == []


def test_a_drive_that_fails_leaves_nothing(tmp_path):
    wide = load_scenario("paper-robot", ["pipe.inner_radius_mm=100", "pipe.end_mm=1100", "pipe.features=[]"])
    with pytest.raises(RunFailed, match=r"^drive: the robot does not fit"):
        run(wide, tmp_path / "run", 1, _quiet)
    assert list(tmp_path.iterdir()) == []


def test_a_scan_that_sees_nothing_fails_and_keeps_the_older_run(first, tmp_path):
    shutil.copytree(first, tmp_path / "run")
    with pytest.raises(RunFailed, match=r"^reconstruct: no frame registered: "):
        run(_short([*SHORT, "sensing.points.drop_out_share=0.999"]), tmp_path / "run", 1, _quiet)
    assert [file.name for file in tmp_path.iterdir()] == ["run"]
    assert (tmp_path / "run" / "score.json").read_bytes() == (first / "score.json").read_bytes()


def _pictured(fidelity: str, folder: Path, workers: int) -> bytes:
    return _run(_short([*FEW_PICTURES, f"sensing.fidelity={fidelity}"]), folder, workers)


@pytest.fixture(scope="module")
def raycast(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "raycast"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "write_report", _no_page)
        _pictured("raycast", folder, 2)
    return folder


def test_pictures_score_the_same_with_any_number_of_workers(raycast, tmp_path, no_report):
    assert _pictured("raycast", tmp_path / "run", 1) == (raycast / "score.json").read_bytes()


def _radius_px(recording: Recording, index: int) -> np.ndarray:
    """Where each slit lies on each of the decoder's lines, NaN where it was not seen."""
    seen = see(recording[index], recording.rig, Method())
    out = seen.pixel - [recording.rig.camera.cx_px, recording.rig.camera.cy_px]
    line = np.rint(np.arctan2(out[:, 0], -out[:, 1]) / (2 * np.pi) * LINES).astype(int) % LINES
    radius = np.full((LINES, len(recording.rig.projector.slits)), np.nan)
    radius[line, seen.slit] = np.hypot(*out.T)
    return radius


def test_a_drawn_scan_and_a_ray_cast_one_decode_alike(raycast, tmp_path, no_report):
    _pictured("picture", tmp_path / "run", 1)
    cast, drawn = open_recording(raycast / "recording"), open_recording(tmp_path / "run" / "recording")
    assert len(cast) == len(drawn) == 3
    for index in range(3):
        apart = _radius_px(drawn, index) - _radius_px(cast, index)
        both = np.isfinite(apart)
        assert both.sum() > 0.7 * LINES * 7
        assert np.median(np.abs(apart[both])) < 0.05
        assert np.abs(np.nanmedian(apart, axis=0)).max() < 0.05
    rows = [json.loads((folder / "score.json").read_text()) for folder in (raycast, tmp_path / "run")]
    assert rows[0]["frames_registered"] == rows[1]["frames_registered"] == 3
    assert rows[0]["center_rms_mm"] == pytest.approx(rows[1]["center_rms_mm"], abs=0.02)
