"""Every fault of a scenario file is one line that leads to its place, and all of them are said at once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from scenarios.document import LARGEST_FILE_BYTES, BadInput, parse
from scenarios.load import library, load_scenario, to_scenario
from scenarios.settings_yaml import settings_yaml
from sensor_model.plain_yaml import scalar

GOOD = """\
name: small
why: a test
pipe:
  inner_radius_mm: 76.2
  wall_thickness_mm: 7.5
  features:
    - {kind: pit, distance_mm: 300, clock_deg: "4:00", depth_mm: 3, diameter_mm: 20}
drive:
  kind: gantry
  stages:
    - to_mm: 600
"""
KEYS_OF_PIT = "known here: distance_mm, clock_deg, depth_mm, kind, diameter_mm, shape"


@pytest.fixture(autouse=True)
def _in_tmp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def faults(text: str | bytes, *changes: str) -> list[str]:
    """The lines that a file with this content is answered with."""
    Path("s.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(BadInput) as caught:
        load_scenario("s.yaml", changes)
    return caught.value.lines


def swapped(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


@pytest.mark.parametrize("name", ["paper-robot", "paper-gantry"])
def test_the_library_loads_and_reads_back_from_its_own_dump(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert name in library()
    assert to_scenario(parse(settings_yaml(scenario), "dump")) == scenario
    assert [feature.clock_deg for feature in scenario.pipe.features] == [120.0, 120.0]
    assert [feature.distance_mm - feature.size(76.2).length_mm / 2 for feature in scenario.pipe.features] == [250, 450]


def test_settings_and_seed_are_laid_over_the_file() -> None:
    Path("s.yaml").write_text(GOOD)
    changes = ["pipe.features.0.depth_mm=2e0", "sensing.points.pixel_noise_px=0", "drive.offset_mm=[1, 2]", "seed=3"]
    scenario = load_scenario("s.yaml", changes, seed=7)
    assert scenario.pipe.features[0].depth_mm == 2.0
    assert scenario.sensing.points.pixel_noise_px == 0
    assert scenario.drive.offset_mm == (1, 2)
    assert scenario.seed == 7


def test_rig_and_optics_go_by_name() -> None:
    Path("s.yaml").write_text(GOOD + "rig: endoscope-measured\nsensing: {optics: endoscope}\n")
    scenario = load_scenario("s.yaml")
    assert scenario.rig.projector.slit_width_deg == 0.8
    assert scenario.sensing.optics.haze == 0.38
    assert to_scenario(parse(settings_yaml(scenario), "dump")) == scenario


def test_a_true_rig_states_only_what_differs() -> None:
    Path("s.yaml").write_text(GOOD + "rig: {camera: {fx_px: 600}}\ntrue_rig: {camera: {fy_px: 601}}\n")
    scenario = load_scenario("s.yaml")
    assert scenario.true_rig is not None
    assert (scenario.true_rig.camera.fx_px, scenario.true_rig.camera.fy_px) == (600, 601)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "diameter_mm",
            "diametre_mm",
            f"s.yaml:7:69: pipe.features.0.diametre_mm: got an unknown key; {KEYS_OF_PIT}; did you mean diameter_mm",
        ),
        (
            "depth_mm: 3",
            "depth_in: 0.1",
            f"s.yaml:7:56: pipe.features.0.depth_in: got an unknown key; {KEYS_OF_PIT}; did you mean depth_mm",
        ),
        ("depth_mm: 3", "depth_mm: 3 mm", "s.yaml:7:66: pipe.features.0.depth_mm: got '3 mm'; must be a number"),
        ("depth_mm: 3", 'depth_mm: "3"', "s.yaml:7:66: pipe.features.0.depth_mm: got '3'; must be a number"),
        ("depth_mm: 3", "depth_mm: .inf", "s.yaml:7:66: pipe.features.0.depth_mm: got '.inf'; must be a number"),
        ("depth_mm: 3", "depth_mm: 1e999", "s.yaml:7:66: pipe.features.0.depth_mm: got inf; must be a finite number"),
        (
            '"4:00"',
            '"4:60"',
            "s.yaml:7:48: pipe.features.0.clock_deg: got '4:60'; "
            "must be degrees, or a clock position from 1:00 to 12:59",
        ),
        ("s_mm: 7.5", "s_mm: -7.5", "s.yaml:5:22: pipe.wall_thickness_mm: got -7.5; must be greater than 0"),
        ("depth_mm: 3,", "", "s.yaml:7:7: pipe.features.0.depth_mm: got nothing; required"),
        ("h_mm: 3", "h_mm: 8", "s.yaml:7:66: pipe.features.0.depth_mm: got 8; must be at most the wall, 7.5 mm"),
        (
            "diameter_mm: 20",
            "diameter_mm: 5",
            "s.yaml:7:7: pipe.features.0: got {kind: 'pit', distance_mm: 300, clock_deg: '4:00', depth_...; "
            "depth_mm of a spherical pit is at most half its diameter, 2.5 mm",
        ),
        (
            "300",
            "898",
            "s.yaml:7:32: pipe.features.0.distance_mm: got 898; "
            "the pit would reach from 888 to 908 mm, and the pipe from -400 to 900 mm",
        ),
        (
            "to_mm: 600",
            "to_mm: 901",
            "s.yaml:11:14: drive.stages.0.to_mm: got 901; must lie in the pipe, from -400 to 900 mm",
        ),
        (
            "kind: pit",
            "kind: pitt",
            "s.yaml:7:14: pipe.features.0.kind: got 'pitt'; "
            "must be one of pocket, pit, scratch, corrosion, dent, hole; did you mean pit",
        ),
        (
            "kind: pit, ",
            "",
            "s.yaml:7:7: pipe.features.0.kind: got nothing; must be one of pocket, pit, scratch, corrosion, dent, hole",
        ),
        (
            "kind: gantry",
            "kind: gantri",
            "s.yaml:9:9: drive.kind: got 'gantri'; must be one of robot, gantry, recorded; did you mean gantry",
        ),
        ("    - to_mm: 600", "    []", "s.yaml:11:5: drive.stages: got []; the list must have at least 1 item"),
        ("why: a test", "why: [a]", "s.yaml:2:6: why: got ['a']; must be text"),
        ("why: a test", "why: a test\nwhy: b", "s.yaml:3:1: why: got the key a second time; it stands already at 2:1"),
        ("why: a test", "why: &a test\nseed: *a", "s.yaml:3:7: seed: got alias *a; write the value out"),
        (
            "why: a test",
            "why: !!python/name:os.system x",
            "s.yaml:2:6: why: got tag tag:yaml.org,2002:python/name:os.system; tags are not understood here",
        ),
        ("why: a test", "why: a: test", "s.yaml:2:7: not YAML: mapping values are not allowed in this context"),
        ("why: a test", "why: a\0test", "s.yaml:2:7: got character U+0000; it may not stand in YAML"),
        ("why: a test", "[a]: b\nwhy: a", "s.yaml:2:1: the file: got a key that is no plain text"),
        ("name: small", "name: ../out", "s.yaml:1:7: name: got '../out'; must match pattern"),
        ("why: a test", "why: a\nseed: 1.5", "s.yaml:3:7: seed: got 1.5; must be a whole number"),
        (
            "why: a test",
            "why: a\nsensing: {fidelity: pictures}",
            "s.yaml:3:21: sensing.fidelity: got 'pictures'; "
            "must be one of 'picture', 'raycast' or 'points'; did you mean picture",
        ),
        ("why: a test", "why: a\nsensing: 3", "s.yaml:3:10: sensing: got 3; must be a mapping of keys to values"),
        (
            "kind: gantry",
            "kind: gantry\n  offset_mm: [70, 70]",
            "s.yaml:10:14: drive.offset_mm: got [70.0, 70.0]; must lie within the bore, 76.2 mm",
        ),
    ],
)
def test_one_fault_is_one_line_that_leads_to_it(old: str, new: str, line: str) -> None:
    lines = faults(swapped(old, new))
    assert len(lines) == 1
    assert lines[0].startswith(line)


def test_a_planar_floor_counts_where_it_is_deepest() -> None:
    pocket = "{kind: pocket, distance_mm: 300, depth_mm: 7, length_mm: 70, width_mm: 35, floor: planar}"
    lines = faults(GOOD.replace(GOOD[GOOD.index("{kind: pit") : GOOD.index("}") + 1], pocket))
    assert lines == [
        "s.yaml:7:50: pipe.features.0.depth_mm: got 7; must be at most the wall, 7.5 mm (8.989 mm where it is deepest)"
    ]


def test_all_faults_are_said_at_once() -> None:
    text = GOOD.replace("depth_mm: 3", "depth_mm: 8").replace("why: a test", "whi: a test\nseed: -1\nrig: {camera: 1}")
    lines = faults(text + "true_rig: {projektor: 1}\n", "drive.speed_mm_s=0", "sensing.optic=1")
    assert [line.split(": got")[0] for line in lines] == [
        "s.yaml:2:1: whi",
        "s.yaml:3:7: seed",
        "s.yaml:4:15: rig.camera",
        "s.yaml:9:66: pipe.features.0.depth_mm",
        "s.yaml:14:12: true_rig.projektor",
        "--set drive.speed_mm_s",
        "--set sensing.optic",
    ]


def test_a_long_list_of_faults_ends_with_their_number() -> None:
    pit = '    - {kind: pit, distance_mm: 300, clock_deg: "4:00", depth_mm: 3, diameter_mm: 20}\n'
    lines = faults(GOOD.replace(pit, pit.replace("depth_mm: 3", "depth_mm: -3") * 60))
    assert len(lines) == 51
    assert lines[-1] == "s.yaml: and 10 more"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ("pipe.features.0.depth_mm=9", "--set pipe.features.0.depth_mm: got 9; must be at most the wall, 7.5 mm"),
        ("pipe.features.0.depth_mm=x", "--set pipe.features.0.depth_mm: got 'x'; must be a number"),
        ("pipe.features.0.depht_mm=1", "--set pipe.features.0.depht_mm: got an unknown key; "),
        ("pipe.features.1.depth_mm=1", "--set pipe.features.1.depth_mm: got item 1; pipe.features has items 0 to 0"),
        ("rig.projector.slits.0=1", "--set rig.projector.slits.0: got item 0; rig.projector.slits is not written out"),
        ("name.x=1", "--set name.x: name is the value 'small'; nothing lies below it"),
        ("drive.offset_mm=[1, 2", "--set drive.offset_mm: not YAML: did not find expected ',' or ']'"),
        ("drive.offset_mm=[1]", "--set drive.offset_mm: drive.offset_mm.1: got nothing; required"),
        ("sensing.optics=dull", "--set sensing.optics: got 'dull'; no look is called 'dull'; there are endoscope"),
        ("seed", "--set seed: give it as path.to.field=value"),
        ("seed=", "--set seed: got nothing; must be a whole number"),
        ("a..b=1", "--set a..b=1: give it as path.to.field=value"),
        ("seed=*x", "--set seed: the file: got alias *x"),
    ],
)
def test_a_wrong_set_names_its_path(change: str, line: str) -> None:
    lines = faults(GOOD, change)
    assert len(lines) == 1
    assert lines[0].startswith(line)


def test_a_wrong_seed_names_its_flag() -> None:
    Path("s.yaml").write_text(GOOD)
    with pytest.raises(BadInput) as caught:
        load_scenario("s.yaml", seed=-1)
    assert caught.value.lines == ["--seed seed: got -1; must be greater than or equal to 0"]


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", "s.yaml:1:1: the file is empty"),
        (b"# only a word\n", "s.yaml:2:1: the file is empty"),
        (b"name: b\xfcrste\n", "s.yaml:1:8: got byte 0xfc; the file must be UTF-8 text"),
        (GOOD.encode("utf-16"), "s.yaml:1:1: got byte 0xff; the file must be UTF-8 text"),
        (b"\x89PNG\r\n", "s.yaml:1:1: got byte 0x89; the file must be UTF-8 text"),
        (b"- a\n- b\n", "s.yaml:1:1: the file: got ['a', 'b']; a scenario is a mapping of keys to values"),
        (b"just words\n", "s.yaml:1:1: the file: got 'just words'; a scenario is a mapping of keys to values"),
        (GOOD.encode() + b"---\na: b\n", "s.yaml:12:1: got a second document; a file holds one"),
        (b"[" * 100_000, "s.yaml:1:34: nested more than 32 deep; no setting lies so deep"),
        (b"{a: " * 100_000, "s.yaml:1:133: nested more than 32 deep; no setting lies so deep"),
        (b"#" * (LARGEST_FILE_BYTES + 1), "s.yaml: got more than 4 MB; a scenario is smaller"),
    ],
)
def test_what_is_no_scenario_at_all(content: bytes, line: str) -> None:
    assert faults(content) == [line]


def test_an_alias_bomb_is_not_expanded() -> None:
    levels = "".join(f"b{i}: &b{i} [{', '.join([f'*b{i - 1}'] * 9)}]\n" for i in range(1, 30))
    lines = faults("b0: &b0 [x]\n" + levels)
    assert "s.yaml:2:10: b1.0: got alias *b0; write the value out" in lines
    assert len(lines) == 51


def test_a_byte_order_mark_is_no_fault() -> None:
    Path("s.yaml").write_bytes(GOOD.encode("utf-8-sig"))
    assert load_scenario("s.yaml").name == "small"


def test_files_that_are_not_there() -> None:
    Path("s.yaml").write_text(GOOD)
    Path("folder.yaml").mkdir()
    os.mkfifo("pipe.yaml")
    for given, line in {
        "t.yaml": "t.yaml: no such file; give a scenario file (.yaml); did you mean s.yaml",
        "none/s.yaml": "none/s.yaml: no such file; give a scenario file (.yaml)",
        "folder.yaml": "folder.yaml: got a folder; give a scenario file (.yaml)",
        "pipe.yaml": "pipe.yaml: got something that is no plain file; give a scenario file (.yaml)",
        "paper-robt": "'paper-robt': no such scenario; give a file, or one of "
        + f"{', '.join(library())}; did you mean paper-robot",
        "/" + "x" * 300: "/" + "x" * 300 + ": cannot be read: File name too long",
        "nul\0.yaml": "nul\0.yaml: no such file; give a scenario file (.yaml)",
    }.items():
        with pytest.raises(BadInput) as caught:
            load_scenario(given)
        assert len(caught.value.lines) == 1
        assert caught.value.lines[0].startswith(line)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("4:00", "4:00"),
        ("yes", "yes"),
        ("2020-01-01", "2020-01-01"),
        ("True", True),
        ("", None),
        ("~", None),
        ("-7", -7),
        (".5", 0.5),
        ("010", 10),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text: str, value: object) -> None:
    assert scalar(text) == value
    assert type(scalar(text)) is type(value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("drive.stages=[{to_mm: 800}]", r"drive: got gantry; the drive leaves the pipe: .* 229 mm ahead, to 1029 mm"),
        ("robot.leg_count=4", r"rig\.wheels\.diameters_mm: got 3 values; one for each of the robot's 4 legs"),
        ("sensing.encoders.wheel_diameter_error_pct=[0, 0]", r"wheel_diameter_error_pct: got 2 values; one for each"),
    ],
)
def test_parts_that_do_not_fit_together_are_named(change: str, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        load_scenario("paper-gantry", [change])


def test_a_method_may_be_named(tmp_path):
    """The library's own, in a scenario, on the command line and below a change; another name says which there are."""
    field = load_scenario("field-dry")
    assert field.method.map.cell_theta_deg == 0.5
    changed = load_scenario("field-dry", ["method.map.cell_z_mm=2"])
    assert changed.method == field.method.model_copy(update={"map": changed.method.map})
    assert (changed.method.map.cell_theta_deg, changed.method.map.cell_z_mm) == (0.5, 2.0)
    assert load_scenario("paper-gantry", method=Path("field")).method == field.method
    assert load_scenario("paper-gantry", ["method=field"]).method == field.method
    (tmp_path / "mine.yaml").write_text((library()["field-dry"]).read_text().replace("method: field", "method: fild"))
    with pytest.raises(BadInput, match=r"mine.yaml:\d+:9: method: got 'fild'; must be settings, or one of field; did"):
        load_scenario(str(tmp_path / "mine.yaml"))
