"""What a reconstruction leaves on disk, in the formats that other tools open: TUM, NPZ, PLY, CSV."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float

from algorithms.large_arrays import lines, percentile
from algorithms.sizing.disposition import at_least
from algorithms.types import Defect, Episode, Reconstruction, Trajectory, WallMap
from sensor_model.geometry import clock_position, wall_direction, wxyz_from_rotation

DEFECT_COLUMNS = (
    "defect",
    "distance_mm",
    "start_mm",
    "clock",
    "theta_deg",
    "length_mm",
    "length_std_mm",
    "width_mm",
    "width_std_mm",
    "depth_mm",
    "depth_std_mm",
    "wall_loss_pct",
    "wall_loss_std_pct",
    "unseen_share",
    "cut_by_scan_end",
    "floor_seen",
    "depth_at_least_mm",
    "volume_mm3",
    "feature_class",
    "disposition",
    "seen_cells",
)
EPISODE_COLUMNS = ("kind", "who", "start_s", "end_s", "amount")


def write_reconstruction(found: Reconstruction, folder: Path) -> None:
    """Write trajectory, wall map, cloud, mesh, defect list and episodes."""
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(found.trajectory, folder / "trajectory.tum")
    wall = found.wall
    write_map(wall, found.deviation_mm, folder / "wall_map.npz")
    write_cloud(wall, found.deviation_mm, folder / "cloud.ply")
    write_mesh(wall, found.deviation_mm, folder / "wall_mesh.ply")
    write_defects(found.defects, folder / "defects.csv")
    write_episodes(found.episodes, folder / "episodes.csv")


def write_map(wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], file: Path) -> None:
    """The map in single precision, as `numpy.savez_compressed` writes it, but a line at a time: a pipe may be long."""
    arrays = {
        "theta_rad": (wall.theta_rad, np.float64),
        "z_mm": (wall.z_mm, np.float64),
        "radius_mm": (wall.radius_mm, np.float32),
        "spread_mm": (wall.spread_mm, np.float32),
        "sigma_mm": (wall.sigma_mm, np.float32),
        "count": (wall.count, np.int32),
        "wall_dev_mm": (deviation_mm, np.float32),
    }
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as held:
        for name, (array, kind) in arrays.items():
            about = {"descr": np.dtype(kind).str, "fortran_order": False, "shape": array.shape}
            with held.open(f"{name}.npy", "w", force_zip64=True) as out:
                np.lib.format.write_array_header_1_0(out, about)
                for (line,) in lines(np.atleast_2d(array)):
                    out.write(line.astype(kind).tobytes())


def write_episodes(episodes: tuple[Episode, ...], file: Path) -> None:
    """Slips, silences and ties to joints, a row each, in order of time."""
    with file.open("w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow(EPISODE_COLUMNS)
        for one in sorted(episodes, key=lambda one: (one.start_ns, one.who)):
            rows.writerow(
                [one.kind, one.who, f"{one.start_ns / 1e9:.3f}", f"{one.end_ns / 1e9:.3f}", f"{one.amount:.2f}"]
            )


def write_tum(path: Trajectory, file: Path) -> None:
    """Registered poses as `timestamp tx ty tz qx qy qz qw`: seconds and metres, as the format says."""
    lines = ["# timestamp[s] tx ty tz[m] qx qy qz qw: camera in the pipe frame"]
    for stamp, T in zip(path.stamp_ns[path.registered], path.T_pipe_camera[path.registered], strict=True):
        w, x, y, z = wxyz_from_rotation(T[:3, :3])
        tx, ty, tz = T[:3, 3] / 1e3
        seconds = f"{stamp // 10**9}.{stamp % 10**9:09d}"  # a double cannot hold a present-day stamp in ns
        lines.append(f"{seconds} {tx:.9f} {ty:.9f} {tz:.9f} {x:.9f} {y:.9f} {z:.9f} {w:.9f}")
    file.write_text("\n".join(lines) + "\n")


def write_defects(defects: tuple[Defect, ...], file: Path) -> None:
    """The defect list, a row a defect, in order of distance."""
    with file.open("w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow(DEFECT_COLUMNS)
        for number, d in enumerate(defects, start=1):
            sizes = (d.length_mm, d.length_std_mm, d.width_mm, d.width_std_mm, d.depth_mm, d.depth_std_mm)
            rows.writerow(
                [
                    number,
                    f"{d.distance_mm:.2f}",
                    f"{d.start_mm:.2f}",
                    clock_position(d.theta_rad),
                    f"{np.degrees(d.theta_rad):.2f}",
                    *(f"{size:.3f}" for size in sizes),
                    f"{d.wall_loss_pct:.1f}",
                    f"{d.wall_loss_std_pct:.2f}",
                    f"{d.unseen_share:.3f}",
                    int(d.cut_by_scan_end),
                    int(d.floor_seen),
                    f"{at_least(d.depth_mm, d.depth_std_mm):.3f}",
                    f"{d.volume_mm3:.1f}",
                    d.feature_class,
                    d.disposition,
                    d.seen_cells,
                ]
            )


def write_cloud(wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], file: Path) -> None:
    """Every seen cell of the map as a coloured point with `wall_dev_mm`, which CloudCompare takes as a scalar field."""
    with file.open("wb") as out:
        _write_vertices(out, wall, deviation_mm, [])


def write_mesh(wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], file: Path) -> None:
    """The seen wall as triangles between neighbouring seen cells; what was not seen stays open."""
    count = sum(len(faces) for faces in mesh_faces(deviation_mm))
    with file.open("wb") as out:
        face_header = [f"element face {count}", "property list uchar int vertex_indices"]
        _write_vertices(out, wall, deviation_mm, face_header)
        for faces in mesh_faces(deviation_mm):
            out.write(faces.tobytes())


def mesh_faces(deviation_mm: Float[np.ndarray, "around along"]) -> Iterator[np.ndarray]:
    """Triangles between seen cells as PLY records, a line of cells at a time; cells count as they are seen."""
    first = before = None
    for here in _numbered_lines(deviation_mm):
        if before is not None:
            yield _faces(before, here)
        first, before = first or here, here
    if first is not None and before is not None:
        yield _faces(before, first)


def _numbered_lines(deviation_mm: Float[np.ndarray, "around along"]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of every line of cells along the pipe its seen cells' numbers, and which were seen."""
    count = 0
    for (line,) in lines(deviation_mm):
        seen = np.isfinite(line)
        yield count + np.cumsum(seen, dtype=np.int32) - 1, seen
        count += int(np.count_nonzero(seen))


def _faces(line: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Triangles between one line of cells and the next around the wall, as PLY records."""
    (here, has), (next_, has_next) = line, after
    lower = has[:-1] & has_next[:-1] & has[1:]
    upper = has_next[:-1] & has_next[1:] & has[1:]
    face = np.zeros(lower.sum() + upper.sum(), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    face["n"] = 3
    face["corners"][: lower.sum()] = np.stack([here[:-1], next_[:-1], here[1:]], axis=1)[lower]
    face["corners"][lower.sum() :] = np.stack([next_[:-1], next_[1:], here[1:]], axis=1)[upper]
    return face


def deepest_shown_mm(deviation_mm: Float[np.ndarray, "around along"]) -> float:
    """The deviation that gets the last colour."""
    deepest = percentile(deviation_mm, 99.5)
    return max(deepest, 0.5) if np.isfinite(deepest) else 1.0


def _write_vertices(
    out: BinaryIO, wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], face_header: list[str]
) -> None:
    """Header and vertices of a binary PLY with one scalar a vertex, which mesh libraries' writers leave out.

    A line of cells at a time, so that a long pipe needs no more memory. Colours are safe for the
    colour-blind (cividis), from the undamaged wall to the deepest place.
    """
    from matplotlib import colormaps

    header = ["ply", "format binary_little_endian 1.0", "comment lengths in mm, pipe frame"]
    header += [f"element vertex {sum(np.count_nonzero(np.isfinite(line)) for (line,) in lines(deviation_mm))}"]
    header += [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    header += ["property float wall_dev_mm", *face_header, "end_header"]
    out.write(("\n".join(header) + "\n").encode())
    deepest = deepest_shown_mm(deviation_mm)
    for theta, (radius, deviation) in zip(wall.theta_rad, lines(wall.radius_mm, deviation_mm), strict=True):
        seen = np.isfinite(deviation)
        vertex = np.zeros(seen.sum(), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3), ("wall_dev_mm", "<f4")])
        vertex["xyz"] = wall_direction(theta) * radius[seen, None]
        vertex["xyz"][:, 2] = wall.z_mm[seen]
        vertex["rgb"] = colormaps["cividis"](deviation[seen] / deepest)[:, :3] * 255
        vertex["wall_dev_mm"] = deviation[seen]
        out.write(vertex.tobytes())
