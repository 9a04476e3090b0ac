"""Every format opened again by a reader that is not its writer."""

from __future__ import annotations

import csv
import struct
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from algorithms.types import INWARD, INWARD_RING, NO_LIGHT
from scenarios.artefacts import write_defects
from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.field.export_tally import tally
from scenarios.field.run_formats import FORMATS, export_run
from scenarios.found_run import read_found
from sensor_model.geometry import wall_angle_rad

OF_THE_LOG = ("mcap", "rosbag2", "video")


@pytest.fixture(scope="module")
def exported(found_folder, tmp_path_factory):
    """One file a format of what was measured, of those whose writers are installed."""
    place = tmp_path_factory.mktemp("export")
    made = {}
    for to, (_, name) in FORMATS.items():
        if to in OF_THE_LOG:
            continue
        try:
            made[to] = export_run(found_folder, to, place / name)
        except BadInput as error:
            assert "pip install 'pipetwin[field]'" in str(error)  # noqa: PT017  the other formats go on
    return made


@pytest.fixture(scope="module")
def run(found_folder):
    return read_found(found_folder)


def test_what_was_written_is_read_back(run, small_scan):
    (read,), (written,) = run.defects, small_scan.found.defects
    assert read.depth_mm == pytest.approx(written.depth_mm, abs=1e-3)
    assert (read.floor_seen, read.cut_by_scan_end, read.seen_cells) == (True, False, written.seen_cells)
    np.testing.assert_allclose(run.T_pipe_camera, small_scan.found.trajectory.T_pipe_camera, atol=1e-5)
    assert run.bore_radius_mm == pytest.approx(76.2, abs=0.02)


def test_tum_holds_metres_and_xyzw(exported, run):
    rows = np.loadtxt(exported["tum"])
    np.testing.assert_allclose(rows[:, 1:4] * 1e3, run.T_pipe_camera[:, :3, 3], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1, atol=1e-8)


@pytest.mark.parametrize("to", ["ply", "stl"])
def test_meshes_are_the_wall(exported, run, to):
    import trimesh

    mesh = trimesh.load(exported[to], process=False)
    x, y, z = mesh.vertices.T
    carved = (np.abs(z - 150) < 12) & (np.abs(wall_angle_rad(x, y) - np.radians(120)) < np.radians(6))
    assert np.median(np.hypot(x, y)[carved]) == pytest.approx(81.2, abs=0.1)
    assert np.median(np.hypot(x, y)) == pytest.approx(76.2, abs=0.02)
    seen = np.isfinite(run.deviation_mm)
    assert z.min() >= run.wall.z_mm[seen.any(axis=0)].min() - 1e-3
    inward = np.einsum("ij,ij->i", mesh.face_normals[:, :2], mesh.triangles_center[:, :2]) < 0
    assert to == "ply" or inward.mean() > 0.99


def test_las_by_its_own_header(exported, run):
    if "las" not in exported:
        pytest.skip("laspy is not installed")
    data = exported["las"].read_bytes()
    assert data[:4] == b"LASF"
    assert data[24:26] == b"\x01\x04"
    offset, _, kind, length = struct.unpack_from("<IIBH", data, 96)
    (count,) = struct.unpack_from("<Q", data, 247)
    scale = np.array(struct.unpack_from("<3d", data, 131))
    assert count == np.isfinite(run.deviation_mm).sum()
    assert len(data) == offset + count * length
    assert kind == 7
    rows = np.frombuffer(data, np.uint8, offset=offset).reshape(count, length)
    xyz_mm = rows[:, :12].copy().view("<i4") * scale * 1e3
    deviation = rows[:, 36:40].copy().view("<f4")[:, 0]
    assert np.median(np.hypot(xyz_mm[:, 0], xyz_mm[:, 1])) == pytest.approx(76.2, abs=0.02)
    assert np.nanmax(run.deviation_mm) == pytest.approx(deviation.max(), abs=1e-4)


def test_e57_by_its_own_header(exported, run):
    if "e57" not in exported:
        pytest.skip("pye57 is not installed")
    data = exported["e57"].read_bytes()
    magic, major, _, length, xml_at, xml_length, page = struct.unpack_from("<8sIIQQQQ", data, 0)
    assert (magic, major, length) == (b"ASTM-E57", 1, len(data))
    whole = b"".join(data[at : at + page - 4] for at in range(0, len(data), page))  # a checksum ends each page
    begin = xml_at - xml_at // page * 4
    words = whole[begin : begin + xml_length].decode()
    assert f'recordCount="{np.isfinite(run.deviation_mm).sum()}"' in words
    assert "cartesianX" in words
    assert "intensity" in words


def test_tables_open_in_a_spreadsheet(exported, run):
    path = np.genfromtxt(exported["csv"] / "path.csv", delimiter=",", names=True)
    np.testing.assert_allclose(path["distance_mm"], run.T_pipe_camera[:, 2, 3], atol=1e-5)
    rows = list(csv.reader((exported["csv"] / "wall.csv").read_text().splitlines()))
    assert len(rows) == 1 + run.wall.z_mm.size
    line = rows[1 + int(np.argmin(np.abs(run.wall.z_mm - 150)))]
    assert float(line[1 + 120]) == pytest.approx(5, abs=0.2)
    assert line[1] == ""  # under the strut


def test_the_tally_tells_joint_place_and_sizes_with_intervals(exported):
    joint, defect = csv.DictReader(exported["tally"].read_text().splitlines())
    assert (joint["kind"], joint["joint"], joint["distance_mm"]) == ("joint", "1", "40.50")
    assert (defect["kind"], defect["joint"], defect["clock"], defect["remark"]) == ("defect", "1", "4:00", "")
    assert float(defect["from_upstream_joint_mm"]) == pytest.approx(150 - 40.5, abs=1.0)
    for name, true in (("length", 40), ("width", 30), ("depth", 5)):
        low, value, high = (float(defect[f"{name}{end}_mm"]) for end in ("_low", "", "_high"))
        assert low < value < high
        assert low <= true <= high
    assert 0.8 < float(defect["seen_share"]) <= 1
    assert abs(float(defect["deepest_mm"]) - 150) < 20
    assert defect["disposition"] == "reject"


def test_what_is_cut_or_dark_has_an_open_end_and_says_so(run, tmp_path):
    (one,) = run.defects
    row = tally(replace(run, defects=(replace(one, cut_by_scan_end=True, floor_seen=False),)))[1]
    assert row["remark"].startswith("cut by the scan's end: the length is a least one; no light reached the floor")
    assert (row["length_high_mm"], row["depth_high_mm"], row["wall_loss_high_pct"]) == ("", "", "")
    assert float(row["depth_low_mm"]) < one.depth_mm < 5.5


def test_rings_are_joints_and_what_stands_inward_or_in_the_dark_is_told_so(run):
    (one,) = run.defects
    ring = replace(one, start_mm=220.0, length_mm=6.0, feature_class=INWARD_RING, disposition="", wall_loss_pct=0.0)
    dent = replace(one, start_mm=240.0, length_mm=20.0, feature_class=INWARD, disposition="", wall_loss_pct=0.0)
    dark = replace(one, start_mm=280.0, depth_mm=0.0, wall_loss_pct=0.0, floor_seen=False, feature_class=NO_LIGHT)
    rows = tally(replace(run, defects=(one, ring, dent, dark)))
    assert [(row["kind"], row["joint"]) for row in rows] == [
        *(("joint", 1), ("defect", 1)),
        *(("joint", 2), ("defect", 2), ("defect", 2)),
    ]
    assert rows[3]["from_upstream_joint_mm"] == "27.00"
    assert rows[3]["remark"] == "stands inward: its depth is a height, and takes no wall"
    assert (rows[4]["remark"], rows[4]["depth_high_mm"]) == ("a dark place alone: nothing is known of its depth", "")


def test_the_command_says_what_it_cannot_do(found_folder, tmp_path):
    runner = CliRunner()
    with pytest.raises(BadInput, match="got docx; a run goes to mcap, rosbag2, video, tum"):
        runner.invoke(app, ["export", str(found_folder), "--to", "docx"], catch_exceptions=False)
    with pytest.raises(BadInput, match="cannot be written: No such file"):
        export_run(found_folder, "tally", tmp_path / "no" / "tally.csv")
    assert not (tmp_path / "no").exists()
    done = runner.invoke(app, ["export", str(found_folder), "--to", "tally", "-o", str(tmp_path / "t.csv")])
    assert done.output == f"{tmp_path / 't.csv'}\n"


def test_a_damaged_run_is_named_by_file_line_and_value(small_scan, tmp_path, found_folder):
    from shutil import copytree

    folder = tmp_path / "run"
    copytree(found_folder, folder)
    made = folder / "reconstruction"
    write_defects(small_scan.found.defects, made / "defects.csv")
    text = (made / "defects.csv").read_text()
    (made / "defects.csv").write_text(text.replace(",4:00,", ",4:00,deep", 1))
    with pytest.raises(BadInput, match=r"defects\.csv:2: theta_deg: got 'deep.*must be a finite number"):
        read_found(folder)
    (made / "trajectory.tum").write_text("0 1 2\n")
    with pytest.raises(BadInput, match=r"trajectory\.tum:1: got '0 1 2'; 8 finite numbers"):
        read_found(folder)
    np.savez(made / "wall_map.npz", theta_rad=np.array([object()]), allow_pickle=True)
    with pytest.raises(BadInput, match=r"wall_map\.npz: "):
        read_found(folder)
    with pytest.raises(BadInput, match="reconstruction/ is missing"):
        read_found(tmp_path)
