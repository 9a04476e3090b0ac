"""The closed loop: what the twin carves, the measurement finds, and each error shows where it must."""

from __future__ import annotations

import numpy as np
import pytest

SHORT = ("drive.stages=[{to_mm: 150, roll_to_deg: 25}, {to_mm: 300}]", "sensing.frame_rate_hz=10")
POCKETS = (
    "pipe.features=[{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 50, width_mm: 30, depth_mm: 7.5},"
    "{kind: pocket, distance_mm: 290, clock_deg: 120, length_mm: 50, width_mm: 30, depth_mm: 3.75}]"
)
CLEAN = "pipe.features=[]"


def test_the_chain_s_own_floor(scan_of):
    row = scan_of("paper-gantry-noiseless", *SHORT, POCKETS).score
    assert (row.defects_found, row.false_calls) == (2, 0)
    assert row.radius_closeness_wall_pct / 100 * 76.2 < 0.02
    assert row.depth_error_mm_max < 0.1
    assert row.center_rms_mm < 0.02
    assert row.tilt_rms_deg < 0.02
    assert row.roll_rms_deg < 0.02
    assert row.distance_error_pct < 0.01


def test_with_noise_it_stays_within_what_an_inspector_allows(scan_of):
    row = scan_of("paper-gantry", *SHORT, POCKETS).score
    assert (row.defects_found, row.false_calls) == (2, 0)
    assert row.length_error_mm_max < 5
    assert row.width_error_mm_max < 3
    assert row.depth_error_mm_max < 0.75
    assert row.center_rms_mm < 0.15
    assert row.roll_rms_deg < 1
    assert row.clock_spread_deg < 1


def test_the_robot_is_measured_as_well(scan_of):
    row = scan_of("paper-robot", "drive.end_mm=300", "sensing.frame_rate_hz=10", POCKETS).score
    assert (row.defects_found, row.false_calls) == (2, 0)
    assert row.depth_error_mm_max < 0.75
    assert row.center_rms_mm < 0.15
    assert row.distance_error_pct < 0.2


def test_a_clean_pipe_gives_no_call_and_no_figures_of_size(scan_of):
    row = scan_of("paper-gantry", *SHORT, CLEAN).score
    assert (row.defects_true, row.defects_found, row.false_calls) == (0, 0, 0)
    assert row.depth_error_mm_max is row.not_seen_share is row.clock_spread_deg is None


def test_a_launch_further_down_the_pipe_is_taken_into_account(scan_of):
    row = scan_of("paper-gantry", "drive.start_mm=100", "drive.stages=[{to_mm: 330}]", POCKETS).score
    assert row.defects_found >= 1
    assert row.map_rms_mm < 0.4


def test_a_wrong_calibration_shows_as_a_wrong_radius(scan_of):
    right = scan_of("paper-gantry-noiseless", "drive.stages=[{to_mm: 60}]", CLEAN)
    wrong = scan_of(
        "paper-gantry-noiseless", "drive.stages=[{to_mm: 60}]", CLEAN, "true_rig.projector.apex_mm=[0, 0, -53.5]"
    )
    assert right.score.radius_closeness_wall_pct < 0.01
    assert wrong.score.radius_closeness_wall_pct > 0.3


def test_a_bore_that_is_not_the_nominal_one_is_found(scan_of):
    scan = scan_of(
        "paper-gantry",
        "drive.stages=[{to_mm: 60}]",
        CLEAN,
        "pipe.inner_radius_mm=77",
        "nominal_pipe={inner_radius_mm: 76.2, wall_thickness_mm: 7.5}",
    )
    assert np.median(scan.found.trajectory.radius_mm) == pytest.approx(77, abs=0.05)
    assert scan.score.false_calls == 0


def test_a_hole_is_not_filled_in(scan_of):
    scan = scan_of("paper-gantry", "drive.stages=[{to_mm: 150}]", POCKETS, "pipe.backed=false")
    assert scan.score.not_seen_share > 0.6
    assert np.nanmax(scan.found.wall.radius_mm) < 76.2 + 7.5 + 1.1


@pytest.mark.parametrize("incline", [-30, 90])
def test_inclined_and_vertical_pipes(scan_of, incline):
    row = scan_of("paper-gantry", *SHORT, POCKETS, f"pipe.inclination_deg={incline}").score
    assert row.defects_found == 2
    assert row.center_rms_mm < 0.15
    assert row.clock_spread_deg < 1.5


def test_kalman_roll_is_blind_to_a_coarse_attitude(scan_of):
    coarse = "sensing.imu.quaternion_rounding=0.01"
    device = scan_of("paper-gantry", *SHORT, CLEAN, coarse).score.roll_rms_deg
    kalman = scan_of("paper-gantry", *SHORT, CLEAN, coarse, "method.localisation.roll=kalman").score.roll_rms_deg
    assert kalman < 0.3 < device


def test_registration_that_fails_is_said_and_the_scan_goes_on(scan_of):
    scan = scan_of("paper-gantry", "drive.stages=[{to_mm: 30}]", CLEAN, "sensing.points.drop_out_share=0.995")
    path = scan.found.trajectory
    lost = ~path.registered
    assert 0 < lost.sum() < lost.size
    assert all(reason.endswith("are needed") for reason, gone in zip(path.reason, lost, strict=True) if gone)
