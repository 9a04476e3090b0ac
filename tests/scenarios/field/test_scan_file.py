"""A pipe made from a scan of a pipe: the loop closes, and bad files say what is wrong with them."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.field.match import matched
from scenarios.field.scan_file import filled
from scenarios.found_run import read_found
from scenarios.load import load_scenario
from scenarios.settings_yaml import settings_yaml

SCENARIO = """
name: again
why: The same pipe, from its own scan.
pipe: {inner_radius_mm: 76.2, wall_thickness_mm: 7.5, start_mm: -200, end_mm: 700, scanned: {file: SCAN}}
drive: {kind: gantry, stages: [{to_mm: 230}], offset_mm: [-1, 2]}
sensing: {fidelity: points}
"""
CARVED = (
    "pipe.features=[{kind: pocket, distance_mm: 160, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 4},"
    "{kind: pocket, distance_mm: 250, clock_deg: 240, length_mm: 25, width_mm: 25, depth_mm: 2}]"
)


@pytest.fixture(scope="module")
def first(run_of, tmp_path_factory):
    folder = tmp_path_factory.mktemp("loop") / "first"
    return run_of(folder, "pipe.end_mm=700", CARVED, "drive.stages=[{to_mm: 230}]", "drive.offset_mm=[2, -1]")


def scenario_of(folder, scan):
    folder.mkdir(exist_ok=True)
    (folder / "again.yaml").write_text(SCENARIO.replace("SCAN", scan))
    return folder / "again.yaml"


def test_a_scan_of_the_scan_finds_the_same_defects(first, run_of, tmp_path):
    file = scenario_of(tmp_path / "spool", "wall_map.npz")
    shutil.copyfile(first / "reconstruction" / "wall_map.npz", file.parent / "wall_map.npz")
    before, after = read_found(first), read_found(run_of(tmp_path / "second", name=str(file), seed=3))
    pocket, small = matched(before, after).rows
    for row in (pocket, small):
        assert row.fate == "paired"
        assert abs(row.growth["depth"].change_mm) < 0.05
        assert abs(row.growth["width"].change_mm) < 0.5
        assert abs(row.growth["length"].change_mm) < 1.5
        assert {growth.verdict for growth in row.growth.values()} == {"no change shown"}


def test_a_cloud_and_a_map_are_one_wall(first, tmp_path):
    walls = []
    for name in ("wall_map.npz", "cloud.ply"):
        file = scenario_of(tmp_path / "spool", name)
        shutil.copyfile(first / "reconstruction" / name, file.parent / name)
        walls.append(load_scenario(str(file)).pipe.scanned)
    np.testing.assert_allclose(walls[0].radius_mm, walls[1].radius_mm, atol=0.002)
    assert walls[0].first_z_mm == walls[1].first_z_mm


def test_stl_out_and_scanned_back_is_the_same_wall(first, tmp_path):
    import trimesh

    from scenarios.field.run_formats import export_run

    mesh = trimesh.load(export_run(first, "stl", tmp_path / "wall.stl"))
    file = scenario_of(tmp_path / "spool", "wall.ply")
    mesh.export(file.parent / "wall.ply")
    x, y, z = mesh.vertices.T.astype(float)
    radius = load_scenario(str(file)).pipe.radius(np.arctan2(x, -y), z)
    np.testing.assert_allclose(radius, np.hypot(x, y), atol=0.002)
    assert len(z) > 0.9 * np.isfinite(read_found(first).deviation_mm).sum()


def test_a_run_folder_needs_the_file_no_more_and_reads_back_the_same(first, tmp_path):
    file = scenario_of(tmp_path / "spool", "wall_map.npz")
    shutil.copyfile(first / "reconstruction" / "wall_map.npz", file.parent / "wall_map.npz")
    scenario = load_scenario(str(file))
    (tmp_path / "kept.yaml").write_text(settings_yaml(scenario))
    assert load_scenario(str(tmp_path / "kept.yaml")) == scenario
    assert scenario.pipe.scanned.file == "wall_map.npz"


def test_paths_stay_in_the_scenario_files_folder(tmp_path):
    (tmp_path / "secret.npz").write_bytes(b"")
    for name, words in (
        ("../secret.npz", "relative path that stays in"),
        (str(tmp_path / "secret.npz"), "relative path that stays in"),
        ("spool.txt", "no such file"),
    ):
        with pytest.raises(BadInput, match=rf"again\.yaml:4:.*pipe\.scanned\.file: got .*{words}"):
            load_scenario(str(scenario_of(tmp_path / "spool", name)))
    (tmp_path / "spool" / "link.npz").symlink_to(tmp_path / "secret.npz")
    with pytest.raises(BadInput, match="leads out of the scenario file's folder"):
        load_scenario(str(scenario_of(tmp_path / "spool", "link.npz")))


def _ply(body: bytes, header: str) -> bytes:
    return f"ply\n{header}\nend_header\n".encode() + body


PLAIN = "format ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z"
BAD = {
    "empty.ply": (b"", "is no PLY"),
    "no-end.ply": (b"ply\n" + b"comment\n" * 500, "is no PLY"),
    "many.ply": (_ply(b"", PLAIN.format(10**12)), "at most 20000000 vertices"),
    "short.ply": (_ply(b"1 2 3\n", PLAIN.format(2)), r"vertex 1: got \[\]; 3 numbers are expected"),
    "words.ply": (_ply(b"1 2 deep\n", PLAIN.format(1)), "vertex 0: got .*3 numbers"),
    "binary.ply": (
        _ply(b"1234", PLAIN.format(2).replace("ascii", "binary_little_endian")),
        "2 vertices are promised, 0",
    ),
    "flat.ply": (_ply(b"", PLAIN.format(1).replace("float z", "float w")), "x, y and z are needed"),
    "nan.ply": (_ply(b"1 2 nan\n", PLAIN.format(1)), "a vertex is no number"),
    "none.ply": (_ply(b"", PLAIN.format(0)), "has no vertex"),
    "long.ply": (_ply(b"76 0 0\n76 0 1e6\n", PLAIN.format(2)), "reaches over 1e.06 mm of z; at most 2777 mm"),
    "sparse.ply": (_ply(b"76 0 0\n76 0 50\n", PLAIN.format(2)), "% of its cells were seen; at least 30 %"),
    "text.npz": (b"no zip", "cannot be read: File is not a zip file"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_says_so(tmp_path, name):
    file = scenario_of(tmp_path / "spool", name)
    (file.parent / name).write_bytes(BAD[name][0])
    with pytest.raises(BadInput, match=BAD[name][1]) as told:
        load_scenario(str(file))
    assert str(told.value).startswith(f"{file}:4:")
    assert name in str(told.value)


def test_bad_grids_say_so(tmp_path):
    file = scenario_of(tmp_path / "spool", "grid.npz")
    theta, z = (np.arange(36) + 0.5) * np.pi / 18, np.arange(20) + 0.5
    for arrays, words in (
        ({"theta_rad": theta, "z_mm": z}, "radius_mm missing"),
        ({"theta_rad": theta, "z_mm": z, "radius_mm": np.ones((20, 36))}, "radius_mm has shape"),
        ({"theta_rad": theta, "z_mm": z**2, "radius_mm": np.full((36, 20), 76.0)}, "must lie evenly"),
        ({"theta_rad": theta, "z_mm": z, "radius_mm": np.full((36, 20), np.nan)}, "0.0 % of its cells were seen"),
        ({"theta_rad": theta, "z_mm": z, "radius_mm": np.array([[b"x"]])}, "numbers are expected"),
        ({"theta_rad": theta, "z_mm": z, "radius_mm": np.array([[None]])}, "got object; numbers are expected"),
    ):
        np.savez(file.parent / "grid.npz", **arrays)
        with pytest.raises(BadInput, match=words):
            load_scenario(str(file))


def test_a_shadow_takes_its_deeper_end_and_the_strut_its_rows_median():
    radius = np.full((12, 60), 76.0)
    radius[3, 20:40] = 80.0
    radius[3, 18:26] = np.nan  # a shadow behind the near rim
    radius[5, 30] = np.nan  # one cell lost
    radius[9] = np.nan  # under the strut
    out = filled(radius, 1.0)
    np.testing.assert_array_equal(out[3, 18:26], 80.0)
    assert out[5, 30] == 76.0
    np.testing.assert_array_equal(out[9], 76.0)
    assert np.isfinite(out).all()
