"""A log identified from the outside: the truth is held, the replay is like the log, and what is amiss is said."""

from __future__ import annotations

import json
import shutil
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.extrapolated import extrapolated
from scenarios.field.compare import compare
from scenarios.field.credibility import credibility, sources
from scenarios.field.identify import identify
from scenarios.load import load_scenario
from scenarios.progress import Progress
from scenarios.scenario import Scenario, nominal_pipe, nominal_rig
from sensor_model.optics import Optics
from sensor_model.rig import preset_rig
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate

ROWS = [[0.1 * i, 120 * s, 3.0, -2.0, 0.0, 1.0, -0.8] for i, s in enumerate(np.clip((np.arange(56) - 12) / 31, 0, 1))]
HIDDEN = [
    "sensing.fidelity=points",
    "pipe.inner_radius_mm=74.3",
    "pipe.ovality_pct=1",
    "pipe.features=[]",
    "sensing.points.pixel_noise_px=0.4",
    "sensing.points.drop_out_share=0.05",
    "sensing.imu.gyroscope_noise_density=0.0006",
    "sensing.encoders.wheel_diameter_error_pct=[0.9, -0.6, 0.2]",
    f"drive={json.dumps({'kind': 'recorded', 'rows': ROWS})}",
]
QUIET = Progress(StringIO())


def made(folder: Path, scenario: Scenario) -> Path:
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    told = nominal_rig(scenario), nominal_pipe(scenario)
    list(sense(truth, scenario.rig, *told, scenario.sensing, scenario.seed, folder))
    return folder


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    return made(tmp_path_factory.mktemp("identify") / "log", load_scenario("paper-gantry", HIDDEN))


@pytest.fixture(scope="module")
def found(log) -> dict:
    return identify(log, None, Optics(), log.parent / "twin.yaml", QUIET)


def test_what_was_hidden_lies_within_the_intervals(found):
    hidden = {"diameter_mm": 148.6, "ovality_pct": 1.0, "pixel_noise_px": 0.4, "drop_out_share": 0.05}
    hidden |= {"gyroscope_noise_density": 6e-4, "tilt_x_deg": 1.0, "tilt_y_deg": -0.8, "offset_x_mm": 3.0}
    rolls = 1 / (1 + np.array([0.9, -0.6, 0.2]) / 100)
    hidden |= {f"wheel{k}_scale_beside_mean_pct": 100 * (rolls.mean() / roll - 1) for k, roll in enumerate(rolls)}
    missed = {
        name: found[name] for name, value in hidden.items() if not found[name]["low"] <= value <= found[name]["high"]
    }
    assert len(missed) <= 1, missed
    assert found["diameter_mm"]["high"] - found["diameter_mm"]["low"] < 0.2
    assert "rest" in found["gyroscope_noise_density"]["source"]
    assert "encoders not at all" in found["wheel_common_scale_pct"]["reason"]


def test_the_truth_has_no_part_in_it(log, found, tmp_path):
    shutil.copytree(log, tmp_path / "run" / "recording")
    assert not (tmp_path / "run" / "truth").exists()
    assert identify(tmp_path / "run", None, Optics(), tmp_path / "again.yaml", QUIET) == found


def test_the_scenario_says_of_each_value_where_it_is_from_and_its_replay_is_like_the_log(log, found, tmp_path):
    text = (log.parent / "twin.yaml").read_text()
    assert "inner_radius_mm: 74." in text
    assert "second differences along the slits" in text
    assert "# Not estimated, and left at the default:" in text
    twin = load_scenario(str(log.parent / "twin.yaml"), [], 5)
    assert twin.drive.kind == "recorded"
    figures = compare(log, made(tmp_path / "replay", twin), tmp_path / "compared", QUIET)
    assert len(figures["outside"]) <= 1, {name: figures["figures"][name] for name in figures["outside"]}
    page = (tmp_path / "compared" / "compare.html").read_text()
    assert "Verified: it computes what it says" in page
    assert json.loads((tmp_path / "compared" / "compare.json").read_text()) == figures
    spoiled = twin.model_copy(
        update={
            "pipe": twin.pipe.model_copy(update={"inner_radius_mm": 74.5}),
            "sensing": twin.sensing.model_copy(
                update={"points": twin.sensing.points.model_copy(update={"pixel_noise_px": 0.5})}
            ),
        }
    )
    worse = compare(log, made(tmp_path / "spoiled", spoiled), tmp_path / "compared", QUIET)
    assert {"diameter_mm", "pixel_noise_px", "residual_mm"} <= set(worse["outside"])


def test_a_dead_wheel_and_dark_frames_are_said(log, tmp_path):
    shutil.copytree(log, tmp_path / "log")
    encoders = tmp_path / "log" / "encoders0" / "data.csv"
    lines = [line.split(",") for line in encoders.read_text().splitlines()]
    encoders.write_text(
        "\n".join([",".join(lines[0]), *(",".join([*row[:2], "0", row[3]]) for row in lines[1:])]) + "\n"
    )
    from sensor_model.recording import SLIT_PIXEL

    for file in (tmp_path / "log" / "cam0" / "data").glob("*.npy"):
        np.save(file, np.zeros(0, SLIT_PIXEL))
    out = tmp_path / "twin.yaml"
    found = identify(tmp_path / "log", None, Optics(), out, QUIET)
    said = " ".join(found["said"])
    assert "Wheel 2 stands while the others roll" in said
    assert "No frame was registered" in said
    assert "no frame registered" in found["diameter_mm"]["reason"]
    assert load_scenario(str(out), [], None).drive.span_mm[1] == pytest.approx(120, abs=2)


def test_another_size_of_rig_or_pipe_is_said(log, tmp_path):
    rig = preset_rig()
    two = rig.model_copy(update={"wheels": rig.wheels.model_copy(update={"diameters_mm": (38.0, 38.0)})})
    with pytest.raises(BadInput, match="got 3 encoder wheels; the rig given has 2"):
        identify(log, two, Optics(), tmp_path / "x.yaml", QUIET)
    shutil.copytree(log, tmp_path / "log")
    pipe = tmp_path / "log" / "pipe.yaml"
    pipe.write_text(pipe.read_text().replace("74.3", "80.0"))
    found = identify(tmp_path / "log", None, Optics(), tmp_path / "x.yaml", QUIET)
    assert "another pipe, or a rig of another size" in " ".join(found["said"])


def test_what_is_no_log_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no log; give a recording"):
        identify(tmp_path / "nothing", None, Optics(), tmp_path / "x.yaml", QUIET)
    (tmp_path / "imu.csv").write_text("head\n21:14:49, 5, 1, 2\n")
    with pytest.raises(BadInput, match=r"imu\.csv:2: got 4 columns; 15 are expected"):
        identify(tmp_path / "imu.csv", None, Optics(), tmp_path / "x.yaml", QUIET)
    with pytest.raises(BadInput, match="neither a run nor a recording"):
        compare(tmp_path, tmp_path, tmp_path / "out", QUIET)


def test_every_group_of_settings_has_its_source_and_leaving_the_range_is_stamped():
    scenario = load_scenario("paper-gantry", [], None)
    named = {group.split(".")[0] for group in sources()}
    assert named == set(Scenario.model_fields) - {"name", "why", "seed", "true_rig", "calibration"}
    parts = {name for group in sources() for name in [group.partition(".")[2]] if group.startswith("sensing.")}
    assert parts == {"optics", "points", "imu", "encoders", "timing"}
    assert extrapolated(scenario) == []
    assert credibility(scenario)[-1].title == "Within the validated range"
    far = load_scenario(
        "paper-gantry",
        ["pipe.features=[]", "drive.tilt_deg=[6, 0]", "sensing.frame_rate_hz=60", "sensing.optics.haze=0.6"],
    )
    reasons = extrapolated(far)
    assert [reason.split(":")[0] for reason in reasons] == ["tilt (degrees)", "frames a second", "haze"]
    assert credibility(far)[-1].title == "Extrapolated"


def test_the_real_imu_log_and_the_real_pictures_are_identified_as_far_as_they_go(shared, tmp_path):
    real = shared / "real"
    if not (real / "imu").is_dir() or not (real / "in_pipe").is_dir():
        pytest.skip("no real log of the sensor's IMU and no real pictures of a pipe")
    found = identify(real / "imu" / "imucam_log_final_cal.csv", None, Optics(), tmp_path / "imu.yaml", QUIET)
    assert found["imu_rate_hz"]["value"] == pytest.approx(15, rel=0.05)
    assert found["gyroscope_noise_density"]["low"] == 0  # it moves all the time
    assert "gravity off" in " ".join(found["said"])
    rig = preset_rig("endoscope-measured")
    from sensor_model.optics import look

    found = identify(real / "in_pipe", rig, look("endoscope"), tmp_path / "pictures.yaml", QUIET)
    assert 136 < found["diameter_mm"]["value"] < 146
    assert 3 * found["edge_jitter_deg"]["value"] == pytest.approx(look("endoscope").slide_jag_deg, rel=0.1)
    assert "smoothed pictures" in found["read_noise"]["reason"]
    assert 0.9 < found["coverage_inner"]["value"] <= 1
    assert 0.2 < found["haze"]["value"] < 0.6
    for name in ("imu.yaml", "pictures.yaml"):
        assert load_scenario(str(tmp_path / name), [], None).drive.kind == "gantry"
