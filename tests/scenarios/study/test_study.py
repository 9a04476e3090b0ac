"""A study file: what it may say, what is said of its faults, and the runs that it plans."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scenarios.document import BadInput
from scenarios.study.plan import Recipe, differences, identity, planned_runs, recipe_of
from scenarios.study.study import load_study

FAULTS = {
    "a path that does not exist": (
        ("0.depth_mm", "0.depht_mm"),
        "5:30: pipe.features.0.depht_mm: no such setting in the base scenario; did you mean pipe.features.0.depth_mm",
    ),
    "a path into nowhere": (("pipe.features.0", "pip.features.0"), "no such setting in the base scenario"),
    "an item that is not there": (("features.0", "features.7"), "no such setting in the base scenario"),
    "an empty list": (("[1, 2, 3]", "[]"), "factors.pipe.features.0.depth_mm: got an empty list"),
    "a value twice": (("[1, 2, 3]", "[1, 2, 1]"), "the same value stands already as item 0"),
    "a value that does not fit": (("[1, 2, 3]", "[1, 20, 3]"), "5:33: pipe.features.0.depth_mm: got 20; must be at"),
    "a value of the wrong type": (("[1, 2, 3]", "[deep]"), "5:30: pipe.features.0.depth_mm: got 'deep'; must be a num"),
    "a negative width": (
        ("{low: 0.1, high: 0.4, steps: 2}", "{distribution: normal, mean: 1, std: -1}"),
        "factors.sensing.points.pixel_noise_px.std: got -1; must be greater than 0",
    ),
    "ends that are swapped": (("high: 0.4", "high: 0.05"), "high must be above low, 0.1"),
    "an unknown distribution": (
        ("{low: 0.1", "{distribution: unifrom, low: 0.1"),
        "got 'unifrom'; must be one of uniform, log-uniform, normal, triangular; did you mean uniform",
    ),
    "a misspelt key of a range": (("steps: 2", "stepz: 2"), "got an unknown key; known here: low, high, whole, steps"),
    "a range without steps in a grid": ((", steps: 2", ""), "a grid needs a list, or a range with steps"),
    "a scalar for a factor": (("[1, 2, 3]", "3"), "must be a list, a range {low, high, steps} or a distribution"),
    "an unknown design": (
        ("kind: grid", "kind: gird"),
        "7:16: design.kind: got 'gird'; must be one of grid, rows, latin-hyp",
    ),
    "no points": (("kind: grid", "kind: sobol, points: 0"), "design.points: got 0; must be greater than or equal to 1"),
    "an unbalanced Sobol": (
        ("kind: grid", "kind: sobol, points: 100"),
        "must be a power of 2 to be balanced; 64 and 128",
    ),
    "no seeds": (("seeds: 4", "seeds: 0"), "design.seeds"),
    "no methods": (("methods:\n  default: {}\n  coarse: {map.cell_z_mm: 5}", "methods: {}"), "methods: got {}"),
    "methods that are the same": (("map.cell_z_mm: 5", "map.cell_z_mm: 1"), "the same method as default"),
    "a misspelt method": (
        ("map.cell_z_mm", "map.cel_z_mm"),
        "no such setting in the base scenario; did you mean method.map",
    ),
    "a method out of a name": (("coarse: {", "../evil: {"), "methods"),
    "an unknown base": (("paper-gantry", "paper-gantri"), "no such scenario; give a file"),
    "an unknown setting": (("sensing.fidelity", "sensing.fidellity"), "got an unknown key; known here: fidelity"),
    "an unknown key": (("name: stand-in", "nome: stand-in"), "did you mean name"),
    "an unknown figure": (("name:", "record: [depth_eror_mm_max]\nname:"), "did you mean depth_error_mm_max"),
    "a path out of the folder": (("name: stand-in", "name: ../../etc"), "1:7: name: got '../../etc'"),
    "no time": (("name:", "time_limit_s: 0\nname:"), "time_limit_s: got 0; must be greater than 0"),
    "a tag": (("[1, 2, 3]", "!!python/object:os.system [1]"), "tags are not understood here"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_said_with_its_place(fault, lab):
    change, words = FAULTS[fault]
    with pytest.raises(BadInput) as said:
        load_study(lab.write(change))
    assert words in str(said.value)
    assert all("study.yaml" in line for line in said.value.lines)


def test_all_faults_come_at_once(lab):
    changes = [
        change for change, _ in (FAULTS["an unknown design"], FAULTS["an empty list"], FAULTS["a negative width"])
    ]
    with pytest.raises(BadInput) as said:
        load_study(lab.write(*changes))
    assert len(said.value.lines) == 3


def test_a_change_that_breaks_something_elsewhere_is_named(lab):
    with pytest.raises(BadInput, match=r"study.yaml:5:22: pipe.end_mm: pipe.features.0.distance_mm: got 285; "):
        load_study(lab.write(("pipe.features.0.depth_mm: [1, 2, 3]", "pipe.end_mm: [900, 300]")))


def test_base_and_method_may_be_files_beside_the_study(lab, tmp_path: Path):
    (tmp_path / "pipe.yaml").write_text(
        "name: own\nwhy: x\nseed: 7\npipe: {inner_radius_mm: 76.2, wall_thickness_mm: 7.5}\n"
        "drive: {kind: gantry, stages: [{to_mm: 50}]}\n"
    )
    (tmp_path / "coarse.yaml").write_text("map: {cell_z_mm: 5}\n")
    text = "name: x\nbase: pipe.yaml\nmethods: {default: null, coarse: coarse.yaml}\n"
    study = load_study(lab.write(text=text))
    assert study.seeds == (7,)
    assert study.planned == 2
    assert study.methods["coarse"]["map"]["cell_z_mm"] == 5.0
    (tmp_path / "coarse.yaml").write_text("map: {cell_z: 5}\n")
    with pytest.raises(BadInput, match=r"coarse.yaml:1:7: method.map.cell_z: got an unknown key"):
        load_study(lab.write(text=text))


# ---- the runs planned


def _runs(file: Path) -> tuple[Recipe, list]:
    study = load_study(file)
    recipe = recipe_of(study, "code")
    return recipe, list(planned_runs(study, recipe))


def test_every_run_has_a_key_of_its_own_and_methods_share_their_seeds(lab):
    _, runs = _runs(lab.write())
    assert len(runs) == 3 * 2 * 4 * 2 == len({run.key for run in runs})
    by_method = [[(r.point, r.seed) for r in runs if r.method == method] for method in ("default", "coarse")]
    assert by_method[0] == by_method[1]


def test_a_key_depends_on_what_makes_the_run_and_on_nothing_else(lab):
    keys = {run.key for run in _runs(lab.write())[1]}
    for harmless in [("name: stand-in", "name: other"), ("default:", "plain:"), ("[1, 2, 3]", "[3.0, 2, 1]")]:
        assert {run.key for run in _runs(lab.write(harmless))[1]} == keys
    other = {run.key for run in _runs(lab.write(("pipe.features.0", "pipe.features.1")))[1]}
    assert not keys & other
    study = load_study(lab.write())
    newer = {run.key for run in planned_runs(study, recipe_of(study, "newer code"))}
    assert not keys & newer


def test_a_worker_makes_the_same_scenario_of_a_job(lab):
    recipe, runs = _runs(lab.write())
    run = runs[-1]
    scenario = recipe.scenario(json.loads(json.dumps(run.values)), run.method, run.seed)
    assert scenario.pipe.features[0].depth_mm == 3.0
    assert scenario.sensing.points.pixel_noise_px == 0.4
    assert scenario.method.map.cell_z_mm == 5.0
    assert scenario.seed == 3


def test_values_that_do_not_fit_together_are_a_failure_of_their_run_only(lab):
    thin = ("sensing.points.pixel_noise_px: {low: 0.1, high: 0.4, steps: 2}", "pipe.wall_thickness_mm: [2, 7.5]")
    shallow = ("{sensing.fidelity: points}", "{pipe.features.1.depth_mm: 1, pipe.features.0.depth_mm: 1}")
    _, runs = _runs(lab.write(thin, shallow))
    faulty = [run for run in runs if run.fault]
    assert {run.values for run in faulty} == {(3, 2)}
    assert "must be at most the wall, 2 mm" in faulty[0].fault
    assert len({run.key for run in runs}) == len(runs)


def test_differences_are_named(lab):
    def of(*change: tuple[str, str]) -> dict:
        return identity(load_study(lab.write(*change)), "code")

    assert list(differences(of(), of())) == []
    (line,) = differences(of(), of(("[1, 2, 3]", "[1, 2]")))
    assert line == "factors.pipe.features.0.depth_mm.values was [1, 2, 3] and is [1, 2]"
    (line,) = differences(of(), of(("map.cell_z_mm: 5", "map.cell_z_mm: 4")))
    assert line == "methods.coarse.map.cell_z_mm was 5.0 and is 4.0"


def test_scenarios_may_be_a_factor(lab):
    """Each run has the base that it names, with `set` and the method's changes laid over that one."""
    text = """\
name: library
base: field-dry
set: {sensing.fidelity: points}
factors:
  scenario: [field-dry, field-oval, field-scratched]
  sensing.points.pixel_noise_px: [0.1, 0.2]
methods: {default: {}, coarse: {map.cell_z_mm: 5}}
"""
    study = load_study(lab.write(text=text))
    recipe = recipe_of(study, "code")
    runs = list(planned_runs(study, recipe))
    assert len({run.key for run in runs}) == 3 * 2 * 2
    made = {(run.values, run.method): recipe.scenario(run.values, run.method, run.seed) for run in runs}
    oval, scratched = made[("field-oval", 0.2), "coarse"], made[("field-scratched", 0.1), "default"]
    assert (oval.name, oval.pipe.ovality_pct, oval.sensing.fidelity) == ("field-oval", 1.0, "points")
    assert (oval.method.map.cell_z_mm, oval.sensing.points.pixel_noise_px) == (5.0, 0.2)
    assert scratched.method.map.cell_theta_deg == 0.25  # its own method, which is not the base's
    assert made[("field-dry", 0.1), "default"].method.map.cell_theta_deg == 0.5
    # what a worker gets travels as JSON
    scenes = json.loads(json.dumps(recipe.scenes))
    other = Recipe(recipe.base, recipe.paths, recipe.methods, recipe.record, "code", scenes)
    assert other.scenario(("field-oval", 0.2), "coarse", 3) == recipe.scenario(("field-oval", 0.2), "coarse", 3)
    with pytest.raises(BadInput, match=r"5:25: factors\.scenario\.1: got 'field-ovl'; no such scenario.*field-oval"):
        load_study(lab.write(text=text.replace("field-oval", "field-ovl")))
    listed = "[field-dry, field-oval, field-scratched]"
    with pytest.raises(BadInput, match=r"must be a list of scenarios' names"):
        load_study(lab.write(text=text.replace(listed, "{low: 1, high: 2, steps: 2}")))
