"""Virtual artefacts: exact points give exact gauges, a wrong rig shows, and reference files are read with care."""

from __future__ import annotations

import json

import numpy as np
import pytest

from scenarios.bench import artefacts
from scenarios.bench.artefacts import ball_center_mm, ring_gauge, run_artefacts, step_gauge
from scenarios.bench.reference import fit_references, words
from scenarios.bench.scans import take_scan
from scenarios.document import BadInput
from scenarios.load import load_scenario
from sensor_model.geometry import swing_onto, wall_direction

NOISELESS = ["sensing.fidelity=points", "sensing.points.pixel_noise_px=0", "sensing.points.drop_out_share=0"]


def quiet(stage: str, done: int, total: int) -> None:
    """Say nothing."""


def test_a_ring_gauge_without_noise_is_exact_and_a_rig_as_drawn_is_not():
    scan = take_scan(load_scenario("paper-gantry", [*artefacts.RING, *NOISELESS]), 1, quiet)
    found = ring_gauge(scan, quiet)
    true_mm, error = found["diameter", artefacts.TRUE_RIG]
    assert true_mm == 152.4
    assert abs(error) < 1e-6
    assert abs(found["diameter", artefacts.CALIBRATED_RIG][1]) < artefacts.DIAMETER_LIMIT_MM
    assert abs(found["diameter", artefacts.DRAWN_RIG][1]) > 0.2


def test_steps_are_measured_to_their_depth():
    two = (
        "pipe.features=[{kind: pocket, distance_mm: 200, clock_deg: 120, length_mm: 50, width_mm: 40, depth_mm: 1},"
        "{kind: pocket, distance_mm: 300, clock_deg: 120, length_mm: 50, width_mm: 40, depth_mm: 4}]"
    )
    changes = [two, "drive.start_mm=60", "drive.stages=[{to_mm: 220}]", *NOISELESS]
    found = step_gauge(take_scan(load_scenario("paper-gantry", changes), 1, quiet), quiet)
    for depth in (1, 4):
        true_mm, error = found[f"step of {depth} mm", "wall map, place known"]
        assert true_mm == depth
        assert abs(error) < 0.02
        assert abs(found[f"step of {depth} mm", "sized blind"][1]) < 0.05


def dented(pipe, shift_mm, rng):
    """Points of the first ball's cap, moved along the pipe."""
    polar, turn = np.arccos(rng.uniform(0.75, 1, 400)), rng.uniform(0, 2 * np.pi, 400)
    r = artefacts.BALL_MM
    along, arc, out = (
        r * np.sin(polar) * np.cos(turn),
        r * np.sin(polar) * np.sin(turn),
        r * np.cos(polar) + artefacts.CENTER_MM[2],
    )
    feature, bore = pipe.features[0], pipe.bore_radius_mm
    xyz = wall_direction(np.radians(feature.clock_deg) + arc / bore) * (bore + out)[:, None]
    xyz[:, 2] = feature.distance_mm + along + shift_mm
    return xyz


def test_a_balls_centre_is_found_where_it_is():
    pipe = artefacts.artefact_scenarios("points", 0)["ball-bar"].pipe
    rng = np.random.default_rng(1)
    here, there = (ball_center_mm(dented(pipe, shift, rng), pipe, 0) for shift in (0.0, 2.5))
    direction = wall_direction(np.radians(120.0)) * (pipe.bore_radius_mm + artefacts.CENTER_MM[2])
    assert np.allclose(here, direction + np.array([0, 0, 220]), atol=1e-5)
    assert np.allclose(there - here, [0, 0, 2.5], atol=1e-5)
    assert np.isnan(ball_center_mm(np.zeros((0, 3)), pipe, 0)).all()


def test_rows_state_mean_and_worst_and_what_could_not_be_measured(tmp_path, monkeypatch):
    given = iter([0.01, -0.03, np.nan])
    by = artefacts.CALIBRATED_RIG
    monkeypatch.setattr(artefacts, "take_scan", lambda *_: None)
    monkeypatch.setattr(artefacts, "MEASURES", {"ring gauge": lambda *_: {("diameter", by): (152.4, next(given))}})
    first = artefacts.artefact_scenarios("points", 0)["ring gauge"]
    monkeypatch.setattr(artefacts, "artefact_scenarios", lambda *_: {"ring gauge": first})
    rows = run_artefacts("points", 3, tmp_path / "a", 1, quiet)
    assert rows[0]["error_mm"] == pytest.approx(-0.01)
    assert rows[0]["worst_mm"] == 0.03
    assert (rows[0]["scans"], rows[0]["missing"]) == (3, 1)
    assert json.loads((tmp_path / "a" / "artefacts.json").read_text()) == rows
    assert artefacts.words(rows).endswith("holds")


def a_cylinder(folder, name, radius):
    rng = np.random.default_rng(7)
    axis = np.array([0.3, -0.2, 0.9])
    axis /= np.linalg.norm(axis)
    turn, along = rng.uniform(0, 2 * np.pi, 40), rng.uniform(-50, 50, 40)
    local = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), along])
    place = np.array([10.0, -20.0, 30.0])
    xyz = local @ swing_onto(np.array([0.0, 0.0, 1.0]), axis).T + place
    np.savetxt(folder / f"{name}.asc", xyz, fmt="%.15g")
    np.savetxt(folder / f"{name}.answer.txt", [*(place + 5 * axis), *axis, radius], fmt="%.15g")


def test_a_reference_cylinder_passes_and_a_wrong_answer_does_not(tmp_path):
    a_cylinder(tmp_path, "a", 30.0)
    a_cylinder(tmp_path, "b", 31.0)
    answer = (tmp_path / "b.answer.txt").read_text().splitlines()
    (tmp_path / "b.answer.txt").write_text("\n".join([*answer[:-1], "31.001"]))
    rows = fit_references(tmp_path)
    assert [row["passes"] for row in rows] == [True, False]
    assert rows[1]["radius_um"] == pytest.approx(1.0, rel=1e-3)
    assert words(rows).endswith("1 of 2 pass")


def test_the_institutes_own_cylinders_pass(shared):
    rows = fit_references(shared / "reference" / "cylinder")
    assert rows
    assert all(row["passes"] for row in rows)


def test_reference_files_that_cannot_be_used_are_named(tmp_path):
    with pytest.raises(BadInput, match=r"no \*.asc"):
        fit_references(tmp_path)
    with pytest.raises(BadInput, match="is no folder"):
        fit_references(tmp_path / "none")
    a_cylinder(tmp_path, "good", 30.0)
    (tmp_path / "alone.asc").write_text("1 2 3\n")
    (tmp_path / "words.asc").write_text("1 2 three\n")
    (tmp_path / "words.answer.txt").write_text("1\n")
    with pytest.raises(BadInput) as told:
        fit_references(tmp_path)
    assert len(told.value.lines) == 2
    assert "alone" in told.value.lines[0]
    assert "three" in told.value.lines[1]
