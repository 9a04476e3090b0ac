"""What a reconstruction leaves on disk, opened again by readers that know nothing of the writer."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.types import Defect, Episode, Reconstruction, Trajectory, WallMap
from scenarios.artefacts import DEFECT_COLUMNS, write_episodes, write_reconstruction

FILES = {"trajectory.tum", "wall_map.npz", "cloud.ply", "wall_mesh.ply", "defects.csv", "episodes.csv"}
AROUND, ALONG, BORE_MM = 36, 20, 76.2
UNSEEN = (slice(10, 14), slice(5, 9))
DENT = (slice(20, 25), slice(8, 12))
DEFECTS = (
    Defect(250.123, 70.456, 35.789, 7.25, np.radians(120), 96.7, 0.4, 0.5, 0.1, 3.6, 0.0, 2000, False),
    Defect(450.0, 20.0, 10.0, 1.5, np.radians(359.9), 20.0, 0.4, 0.5, 0.1, 1.5, 0.25, 200, True),
)
PLY_TYPES = {"float": "<f4", "uchar": "u1", "int": "<i4"}


def _wall(unseen) -> tuple[WallMap, np.ndarray]:
    theta = (np.arange(AROUND) + 0.5) * 2 * np.pi / AROUND
    z = np.arange(ALONG) + 100.5
    deviation = np.zeros((AROUND, ALONG))
    deviation[DENT] = 5.0
    radius, spread, count = BORE_MM + deviation, np.full_like(deviation, 0.1), np.full(deviation.shape, 7)
    for cells in unseen:
        deviation[cells] = radius[cells] = spread[cells] = np.nan
        count[cells] = 0
    return WallMap(theta, z, radius, spread, spread, count), deviation


def _path() -> Trajectory:
    """Five poses turned about all three axes, the fourth of them only predicted."""
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", [[2.0 + i, -1.5, 25.0 * i] for i in range(5)], degrees=True).as_matrix()
    T[:, :3, 3] = [[4.0, -3.0, 3.3333 * i] for i in range(5)]
    registered = np.array([True, True, True, False, True])
    stamps = np.round(np.arange(5) / 15 * 1e9).astype(np.int64)
    reason = ("", "", "", "too few points", "")
    return Trajectory(
        stamps, T, np.zeros((5, 6, 6)), np.ones((5, 6)), registered, np.full(5, BORE_MM), np.ones(5), reason
    )


def _reconstruction(unseen=(UNSEEN,), defects=DEFECTS) -> Reconstruction:
    wall, deviation = _wall(unseen)
    return Reconstruction(_path(), wall, deviation, defects)


@pytest.fixture(scope="module")
def found():
    return _reconstruction()


@pytest.fixture(scope="module")
def folder(found, tmp_path_factory):
    place = tmp_path_factory.mktemp("artefacts") / "reconstruction"
    write_reconstruction(found, place)
    return place


def _read_ply(file) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces by the format's own words: a header of text lines, then packed little-endian rows."""
    header, body = file.read_bytes().split(b"end_header\n", 1)
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    sizes = {words[1]: int(words[2]) for words in map(str.split, lines) if words[0] == "element"}
    scalars = [words[1:] for words in map(str.split, lines) if words[0] == "property" and words[1] != "list"]
    vertex = np.frombuffer(body, [(name, PLY_TYPES[kind]) for kind, name in scalars], sizes["vertex"])
    rest = body[vertex.nbytes :]
    face = np.frombuffer(rest, [("n", "u1"), ("corners", "<i4", 3)], sizes.get("face", 0))
    assert len(rest) == face.nbytes
    assert np.all(face["n"] == 3)
    return vertex, face["corners"]


def _xyz(vertex: np.ndarray) -> np.ndarray:
    return np.stack([vertex[axis] for axis in "xyz"], axis=1)


def _cells(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which cell of the map each point is in: from 12 o'clock (up is -y), clockwise seen along +z."""
    turn = np.mod(np.arctan2(xyz[:, 0], -xyz[:, 1]), 2 * np.pi) / (2 * np.pi)
    return (turn * AROUND).astype(int), np.floor(xyz[:, 2] - 100).astype(int)


def test_these_files_and_no_others(folder):
    assert {file.name for file in folder.iterdir()} == FILES


def test_trajectory_as_other_tools_read_it(folder, found):
    rows = np.loadtxt(folder / "trajectory.tum")  # `#` starts a comment
    path = found.trajectory
    kept = path.registered
    assert rows.shape == (4, 8)
    assert np.allclose(rows[:, 0], path.stamp_ns[kept] / 1e9, atol=1e-9)
    assert np.allclose(rows[:, 1:4] * 1e3, path.T_pipe_camera[kept, :3, 3], atol=1e-5)
    x, y, z, w = rows[:, 4:].T  # the scalar comes last
    third = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    assert np.allclose(third, path.T_pipe_camera[kept, :3, 2], atol=1e-7)
    assert np.allclose(Rotation.from_quat(rows[:, 4:]).as_matrix(), path.T_pipe_camera[kept, :3, :3], atol=1e-7)


def test_wall_map_needs_no_pickle(folder, found):
    with np.load(folder / "wall_map.npz", allow_pickle=False) as arrays:
        stored = {name: arrays[name] for name in arrays.files}
    wall = found.wall
    assert set(stored) == {"theta_rad", "z_mm", "radius_mm", "spread_mm", "sigma_mm", "count", "wall_dev_mm"}
    for name in ("theta_rad", "z_mm", "count"):
        assert np.array_equal(stored[name], getattr(wall, name))
    for name, array in (
        ("radius_mm", wall.radius_mm),
        ("spread_mm", wall.spread_mm),
        ("wall_dev_mm", found.deviation_mm),
    ):
        assert np.allclose(stored[name], array, atol=1e-5, equal_nan=True)


@pytest.mark.parametrize("name", ["cloud.ply", "wall_mesh.ply"])
def test_every_seen_cell_is_a_vertex_with_its_deviation(folder, found, name):
    vertex, _ = _read_ply(folder / name)
    around, along = _cells(_xyz(vertex))
    assert len(vertex) == found.wall.seen.sum() == len(set(zip(around, along, strict=True)))
    assert found.wall.seen[around, along].all()
    assert np.allclose(vertex["wall_dev_mm"], found.deviation_mm[around, along], atol=1e-5)
    assert np.allclose(np.hypot(vertex["x"], vertex["y"]), found.wall.radius_mm[around, along], atol=1e-4)
    assert np.allclose(vertex["z"], found.wall.z_mm[along], atol=1e-4)


def test_trimesh_opens_the_cloud(folder, found):
    import trimesh

    cloud = trimesh.load(folder / "cloud.ply")
    vertex, faces = _read_ply(folder / "cloud.ply")
    assert isinstance(cloud, trimesh.PointCloud)
    assert len(faces) == 0
    assert np.allclose(cloud.vertices, _xyz(vertex))
    deep = found.deviation_mm[_cells(cloud.vertices)] > 0
    assert len(np.unique(cloud.colors[deep], axis=0)) == len(np.unique(cloud.colors[~deep], axis=0)) == 1
    assert cloud.colors[deep][0, :3].sum() > cloud.colors[~deep][0, :3].sum() + 200  # cividis: dark blue to yellow


def test_trimesh_opens_the_mesh(folder, found):
    import trimesh

    mesh = trimesh.load(folder / "wall_mesh.ply", process=False)
    vertex, faces = _read_ply(folder / "wall_mesh.ply")
    assert np.allclose(mesh.vertices, _xyz(vertex))
    assert np.array_equal(mesh.faces, faces)
    colors = np.stack([vertex[name] for name in ("red", "green", "blue")], axis=1)
    assert np.array_equal(mesh.visual.vertex_colors[:, :3], colors)
    assert mesh.is_winding_consistent
    outward = np.sum(mesh.face_normals[:, :2] * mesh.triangles_center[:, :2], axis=1)
    assert np.all(outward > -1e-9) or np.all(outward < 1e-9)


def test_the_mesh_leaves_unseen_cells_open(folder, found):
    import trimesh

    mesh = trimesh.load(folder / "wall_mesh.ply", process=False)
    around, along = (index[mesh.faces] for index in _cells(mesh.vertices))
    steps = np.abs(around - np.roll(around, 1, axis=1))
    assert np.minimum(steps, AROUND - steps).max() == 1  # neighbours only, across 12 o'clock too
    assert np.abs(along - np.roll(along, 1, axis=1)).max() == 1
    turn, place = UNSEEN
    whole, hole = AROUND * (ALONG - 1), (turn.stop - turn.start + 1) * (place.stop - place.start + 1)
    # every square between four seen cells has two triangles; two corners of the hole have one
    assert len(mesh.faces) == 2 * (whole - hole) + 2
    # one piece, open at both ends and at the hole
    assert mesh.body_count == 1
    assert mesh.euler_number == -1


def test_a_wall_seen_everywhere_is_a_closed_tube(tmp_path):
    import trimesh

    write_reconstruction(_reconstruction(unseen=()), tmp_path)
    mesh = trimesh.load(tmp_path / "wall_mesh.ply", process=False)
    assert (len(mesh.faces), mesh.euler_number) == (2 * AROUND * (ALONG - 1), 0)


def test_defect_list_row_by_row(folder):
    with (folder / "defects.csv").open(newline="") as file:
        first, second = csv.DictReader(file)
    assert tuple(first) == DEFECT_COLUMNS
    assert (first["defect"], second["defect"]) == ("1", "2")
    assert float(first["distance_mm"]) == pytest.approx(250.123 + 70.456 / 2, abs=0.006)
    assert float(first["start_mm"]) == pytest.approx(250.123, abs=0.006)
    assert (first["clock"], float(first["theta_deg"])) == ("4:00", 120)
    assert second["clock"] == "12:00"
    sizes = [float(first[f"{name}_mm"]) for name in ("length", "width", "depth")]
    errors = [float(first[f"{name}_std_mm"]) for name in ("length", "width", "depth")]
    assert sizes == pytest.approx([70.456, 35.789, 7.25], abs=6e-4)
    assert errors == [0.4, 0.5, 0.1]
    assert [float(row["wall_loss_pct"]) for row in (first, second)] == [96.7, 20]
    assert [float(row["unseen_share"]) for row in (first, second)] == [0, 0.25]
    assert [row["cut_by_scan_end"] for row in (first, second)] == ["0", "1"]


def test_no_defects_is_a_list_of_none(tmp_path):
    write_reconstruction(_reconstruction(defects=()), tmp_path)
    with (tmp_path / "defects.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [list(DEFECT_COLUMNS)]


def test_a_least_depth_and_what_becomes_of_a_defect_are_in_the_list(tmp_path):
    defect = replace(DEFECTS[0], floor_seen=False, volume_mm3=1234.56, feature_class="general", disposition="undecided")
    write_reconstruction(_reconstruction(defects=(defect,)), tmp_path)
    with (tmp_path / "defects.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["floor_seen"] == "0"
    assert float(row["depth_at_least_mm"]) == pytest.approx(7.25 - 1.645 * 0.1, abs=1e-3)
    assert (row["volume_mm3"], row["feature_class"], row["disposition"]) == ("1234.6", "general", "undecided")


def test_a_wall_never_seen_gives_empty_files_that_open(tmp_path):
    write_reconstruction(_reconstruction(unseen=(np.s_[:, :],), defects=()), tmp_path)
    for name in ("cloud.ply", "wall_mesh.ply"):
        vertex, faces = _read_ply(tmp_path / name)
        assert len(vertex) == len(faces) == 0


def test_a_path_without_registered_frames_is_a_header(found, tmp_path):
    lost = replace(found.trajectory, registered=np.zeros(5, dtype=bool))
    write_reconstruction(replace(found, trajectory=lost), tmp_path)
    (line,) = (tmp_path / "trajectory.tum").read_text().splitlines()
    assert line.startswith("#")


def test_the_same_reconstruction_gives_the_same_bytes(folder, found, tmp_path):
    write_reconstruction(found, tmp_path)
    for name in sorted(FILES):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_episodes_are_listed_in_order_of_time(tmp_path):
    slip = Episode("slip", "wheel 2", 4_000_000_000, 5_500_000_000, -12.345)
    gap = Episode("gap", "encoders0", 1_000_000_000, 2_000_000_000, 1.0)
    write_episodes((slip, gap), tmp_path / "episodes.csv")
    with (tmp_path / "episodes.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[1] == ["gap", "encoders0", "1.000", "2.000", "1.00"]
    assert rows[2] == ["slip", "wheel 2", "4.000", "5.500", "-12.35"]
