"""What a reconstruction leaves on disk, in the formats that other tools open: TUM, NPZ, PLY, CSV."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from algorithms.types import Defect, Reconstruction, Trajectory, WallMap
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
    "unseen_share",
    "cut_by_scan_end",
)


def write_reconstruction(found: Reconstruction, folder: Path) -> None:
    """Write trajectory, wall map, cloud, mesh and defect list."""
    folder.mkdir(parents=True, exist_ok=True)
    write_tum(found.trajectory, folder / "trajectory.tum")
    wall = found.wall
    np.savez_compressed(
        folder / "wall_map.npz",
        theta_rad=wall.theta_rad,
        z_mm=wall.z_mm,
        radius_mm=wall.radius_mm.astype(np.float32),
        spread_mm=wall.spread_mm.astype(np.float32),
        sigma_mm=wall.sigma_mm.astype(np.float32),
        count=wall.count.astype(np.int32),
        wall_dev_mm=found.deviation_mm.astype(np.float32),
    )
    write_cloud(wall, found.deviation_mm, folder / "cloud.ply")
    write_mesh(wall, found.deviation_mm, folder / "wall_mesh.ply")
    write_defects(found.defects, folder / "defects.csv")


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
                    f"{d.unseen_share:.3f}",
                    int(d.cut_by_scan_end),
                ]
            )


def write_cloud(wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], file: Path) -> None:
    """Every seen cell of the map as a coloured point with `wall_dev_mm`, which CloudCompare takes as a scalar field."""
    seen = wall.seen & np.isfinite(deviation_mm)
    _write_ply(file, _cell_points(wall)[seen], _colors(deviation_mm)[seen], deviation_mm[seen])


def write_mesh(wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], file: Path) -> None:
    """The seen wall as triangles between neighbouring seen cells; what was not seen stays open."""
    seen = wall.seen & np.isfinite(deviation_mm)
    number = np.cumsum(seen.ravel()).reshape(seen.shape) - 1
    ahead, around = np.roll(number, -1, axis=0)[:, :-1], number[:, 1:]
    here, across = number[:, :-1], np.roll(number, -1, axis=0)[:, 1:]
    has = seen[:, :-1], np.roll(seen, -1, axis=0)[:, :-1], seen[:, 1:], np.roll(seen, -1, axis=0)[:, 1:]
    lower, upper = has[0] & has[1] & has[2], has[1] & has[2] & has[3]
    faces = np.concatenate(
        [
            np.stack([here[lower], ahead[lower], around[lower]], axis=1),
            np.stack([ahead[upper], across[upper], around[upper]], axis=1),
        ]
    )
    _write_ply(file, _cell_points(wall)[seen], _colors(deviation_mm)[seen], deviation_mm[seen], faces)


def _cell_points(wall: WallMap) -> Float[np.ndarray, "around along 3"]:
    points = wall_direction(wall.theta_rad)[:, None, :] * np.nan_to_num(wall.radius_mm)[:, :, None]
    points[:, :, 2] = wall.z_mm[None, :]
    return points


def _colors(deviation_mm: Float[np.ndarray, "around along"]) -> UInt8[np.ndarray, "around along 3"]:
    """Colour-blind-safe colours (cividis) from the undamaged wall to the deepest place."""
    from matplotlib import colormaps

    seen = deviation_mm[np.isfinite(deviation_mm)]
    top = max(float(np.percentile(seen, 99.5)), 0.5) if seen.size else 1.0
    return (colormaps["cividis"](np.nan_to_num(deviation_mm) / top)[..., :3] * 255).astype(np.uint8)


def _write_ply(
    file: Path,
    xyz_mm: Float[np.ndarray, "n 3"],
    rgb: UInt8[np.ndarray, "n 3"],
    wall_dev_mm: Float[np.ndarray, "n"],
    faces: Int[np.ndarray, "faces 3"] | None = None,
) -> None:
    """Binary little-endian PLY with one scalar a vertex (which mesh libraries' writers leave out)."""
    vertex = np.zeros(len(xyz_mm), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3), ("wall_dev_mm", "<f4")])
    vertex["xyz"], vertex["rgb"], vertex["wall_dev_mm"] = xyz_mm, rgb, wall_dev_mm
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment lengths in mm, pipe frame",
        f"element vertex {len(vertex)}",
    ]
    header += [f"property float {axis}" for axis in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    header += ["property float wall_dev_mm"]
    body = vertex.tobytes()
    if faces is not None:
        face = np.zeros(len(faces), dtype=[("n", "u1"), ("corners", "<i4", 3)])
        face["n"], face["corners"] = 3, faces
        header += [f"element face {len(face)}", "property list uchar int vertex_indices"]
        body += face.tobytes()
    file.write_bytes(("\n".join([*header, "end_header"]) + "\n").encode() + body)
