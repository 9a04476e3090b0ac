"""What was measured from a log, as messages that Foxglove and RViz draw: path, wall and defects, in metres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from algorithms.types import Defect
from scenarios.field import ros
from scenarios.field.wall_points import wall_points
from scenarios.found_run import FoundRun
from sensor_model.geometry import wall_direction, wxyz_from_rotation

PIPE, CAMERA = "pipe", "cam0"
M_PER_MM = 1e-3
WALL_FIELDS = [(name, 4 * k, ros.FLOAT32) for k, name in enumerate(("x", "y", "z", "deviation_mm", "rgb"))]
WALL_POINT = np.dtype([("xyz", "<f4", (3,)), ("deviation_mm", "<f4"), ("bgr", "u1", (3,)), ("none", "u1")])
SEEN_THROUGH = 0.5  # a box must not hide the dent it stands for


def measured(run: FoundRun) -> Iterator[tuple[int, str, Any]]:
    """Stamp, topic and message: a pose and its transform a frame; wall and defects with the last one."""
    stamps_ns = np.rint(run.time_s * 1e9).astype(np.int64).tolist()
    for stamp, T in zip(stamps_ns, run.T_pipe_camera, strict=True):
        yield stamp, "/pose", ros.new(ros.POSE, header=ros.header(stamp, PIPE), pose=_pose(T))
        yield stamp, "/tf", ros.new(ros.TRANSFORMS, transforms=[_transform(stamp, T)])
    if stamps_ns:
        yield stamps_ns[-1], "/wall", _wall(run, stamps_ns[-1])
        markers = [_marker(k, one, run, stamps_ns[-1]) for k, one in enumerate(run.defects)]
        yield stamps_ns[-1], "/defects", ros.new(ros.MARKERS, markers=markers)


def _pose(T_pipe_body: np.ndarray) -> Any:
    w, x, y, z = wxyz_from_rotation(T_pipe_body[:3, :3]).tolist()
    place = ros.new("geometry_msgs/msg/Point", **_xyz(T_pipe_body[:3, 3]))
    turn = ros.new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    return ros.new("geometry_msgs/msg/Pose", position=place, orientation=turn)


def _transform(stamp_ns: int, T_pipe_camera: np.ndarray) -> Any:
    pose = _pose(T_pipe_camera)
    moved = ros.new("geometry_msgs/msg/Vector3", **_xyz(T_pipe_camera[:3, 3]))
    transform = ros.new("geometry_msgs/msg/Transform", translation=moved, rotation=pose.orientation)
    return ros.new(ros.TRANSFORM, header=ros.header(stamp_ns, PIPE), child_frame_id=CAMERA, transform=transform)


def _xyz(place_mm: np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", (M_PER_MM * place_mm).tolist(), strict=True))


def _wall(run: FoundRun, stamp_ns: int) -> Any:
    """Every seen cell, with how far it lies outside the bore, and its colour."""
    cells = wall_points(run)
    rows = np.zeros(len(cells.xyz_mm), dtype=WALL_POINT)
    rows["xyz"], rows["deviation_mm"], rows["bgr"] = M_PER_MM * cells.xyz_mm, cells.deviation_mm, cells.rgb[:, ::-1]
    return ros.cloud(rows, WALL_FIELDS, ros.header(stamp_ns, PIPE))


def _marker(number: int, defect: Defect, run: FoundRun, stamp_ns: int) -> Any:
    """A box about a defect, its sides along the pipe, around it and outward."""
    outward = wall_direction(np.array([defect.theta_rad]))[0]
    T = np.eye(4)
    T[:3, :3] = np.column_stack([np.cross(outward, [0.0, 0.0, 1.0]), outward, [0.0, 0.0, 1.0]])
    T[:3, 3] = outward * (run.bore_radius_mm + defect.depth_mm / 2)
    T[2, 3] = defect.distance_mm
    sides = np.array([defect.width_mm, max(defect.depth_mm, 1.0), defect.length_mm])
    color = ros.new("std_msgs/msg/ColorRGBA", r=0.84, g=0.37, b=0.0, a=SEEN_THROUGH)
    scale = ros.new("geometry_msgs/msg/Vector3", **_xyz(np.where(np.isfinite(sides), sides, 1.0)))
    return ros.box(ros.header(stamp_ns, PIPE), defect.feature_class, number, _pose(T), scale, color)
