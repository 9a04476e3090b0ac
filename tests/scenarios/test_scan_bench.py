"""Whole recordings registered by several methods, and the calibration session in closed loop."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.registration import CylinderMapSettings, EllipsoidSettings
from algorithms.registration.icp import IcpSettings
from scenarios.bench.calibrated import BoardSession, as_drawn, calibrate
from scenarios.bench.clouds import MOST_POINTS
from scenarios.bench.scans import scan_errors, take_scan
from scenarios.load import load_scenario
from scenarios.run import RunFailed
from sensor_model.points import PointNoise
from sensor_model.rig import preset_rig

METHODS = {"ours": CylinderMapSettings(), "peer": EllipsoidSettings(), "icp": IcpSettings()}


def quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""


def short(*changes: str):
    features = (
        "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]"
    )
    stages = "drive.stages=[{to_mm: 60}]"
    return load_scenario(
        "paper-gantry", ["sensing.fidelity=points", "sensing.frame_rate_hz=5", features, stages, *changes]
    )


def rms(errors, method, name):
    return float(np.sqrt(np.mean([getattr(e, name) ** 2 for e in errors if e.method == method])))


def errors_of(seed, methods):
    return [error for errors, _ in scan_errors(short(), seed, methods, 1, quiet) for error in errors]


@pytest.fixture(scope="module")
def found():
    return list(scan_errors(short(), 3, METHODS, 1, quiet))


@pytest.fixture(scope="module")
def errors(found):
    return [error for errors, _ in found for error in errors]


def test_the_clouds_of_the_methods_differ_as_their_poses_do(found):
    clouds = {cloud.method: cloud for _, cloud in found}
    high = {m: np.abs(np.hypot(*c.xyz_mm[:, :2].T) - c.bore_mm) for m, c in clouds.items()}
    assert np.median(high["ours"]) < np.median(high["peer"])
    assert all(1000 < len(cloud.xyz_mm) <= 1.01 * MOST_POINTS for cloud in clouds.values())
    assert np.ptp(clouds["ours"].xyz_mm[:, 2]) > 60


def test_every_frame_is_judged_for_every_method(errors):
    frames = {method: [e.frame for e in errors if e.method == method] for method in METHODS}
    assert frames["ours"] == list(range(len(frames["ours"])))
    assert frames["ours"] == frames["peer"] == frames["icp"]
    assert {e.seed for e in errors} == {3}
    assert all(e.ms > 0 for e in errors)


def test_a_defect_pulls_the_ellipsoid_but_not_ours(errors):
    assert rms(errors, "ours", "center_mm") < 0.05 < rms(errors, "peer", "center_mm")
    assert rms(errors, "ours", "axis_deg") < 0.05 < rms(errors, "peer", "axis_deg")
    assert not any(e.failed for e in errors if e.method == "ours")


def test_icp_claims_motion_along_the_pipe_that_was_not_there(errors):
    assert rms(errors, "icp", "travel_mm") > 10 * rms(errors, "ours", "travel_mm")


def test_the_same_seed_gives_the_same_errors_and_another_does_not(errors):
    def numbers(found):
        return [e.center_mm for e in found if e.method == "ours"]

    alone = {"ours": METHODS["ours"]}
    assert numbers(errors_of(3, alone)) == numbers(errors)
    assert numbers(errors_of(4, alone)) != numbers(errors)


def test_nothing_is_left_on_disk(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    scan = take_scan(short(), 1, quiet)
    assert len(scan.seen) == len(scan.T_true) > 3
    assert not list(tmp_path.iterdir())


def test_a_drive_that_leaves_the_pipe_says_so():
    scenario = short()
    away = scenario.drive.model_copy(update={"start_mm": -390.0})
    with pytest.raises(RunFailed, match="paper-gantry: the drive leaves the pipe"):
        take_scan(scenario.model_copy(update={"drive": away}), 1, quiet)


def test_boards_without_errors_give_the_rig_itself():
    exact = BoardSession(
        boards=4,
        board_distance_std_mm=0,
        board_tilt_std_deg=0,
        points=PointNoise(azimuths=90, pixel_noise_px=0, drop_out_share=0),
    )
    found = calibrate(preset_rig(), 0, exact).rig.projector
    assert np.allclose(found.apex_mm, preset_rig().projector.apex_mm, atol=1e-8)
    assert np.allclose(found.slit_half_angles_rad, preset_rig().projector.slit_half_angles_rad, atol=1e-10)


def test_calibration_mends_what_the_drawing_has_wrong():
    true, few = preset_rig(), BoardSession(points=PointNoise(azimuths=180))
    found = calibrate(true, 1, few)

    def worst_deg(rig):
        off = rig.projector.slit_half_angles_rad - true.projector.slit_half_angles_rad
        return np.degrees(np.abs(off)).max()

    assert worst_deg(found.rig) < 0.02 < worst_deg(as_drawn(true))
    assert found.rig.camera == true.camera
    assert calibrate(true, 1, few).rig == found.rig
    assert calibrate(true, 2, few).rig != found.rig
