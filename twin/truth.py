"""What really happened: the noise-free record of one drive through one pipe, sealed from the measurement."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, Slerp

from sensor_model.geometry import rotation_from_wxyz, transform
from twin.pipe import Pipe

STAMP_STEP_S = 1e-9


@dataclass(frozen=True)
class WheelLog:
    """What every wheel did at its own, lower rate; wheels as `robot_model.wheel_names` has them.

    Normal force on the wall, 0 in the air; slip, the speed of the rim over the wall at the contact along the rolling
    direction, positive where the wheel spins and 0 in the air; spin, how fast the wheel turns.
    """

    time_s: Float[np.ndarray, "m"]
    force_n: Float32[np.ndarray, "m all_wheels"]
    slip_mm_s: Float32[np.ndarray, "m all_wheels"]
    spin_rad_s: Float32[np.ndarray, "m all_wheels"]


@dataclass(frozen=True)
class Truth:
    """Motion of the camera and the wheels at the physics rate; the camera frame is the sensor's.

    The pipe frame is the axis's own where the camera is: z is the way along it, and in a bend the frame turns with it.
    Accelerations are the camera's origin's, over the ground, in the pipe frame's axes; gravity is not in them.
    `wheel_angle_rad` is the turn of each encoder's wheel since the start, `slip_mm_s` its rim speed over the wall less
    the travel speed along the axis (a prescribed path has none); `wheels` says more of each wheel, where there are any.
    """

    pipe: Pipe
    time_s: Float[np.ndarray, "n"]
    position_mm: Float[np.ndarray, "n 3"]
    q_pipe_camera_wxyz: Float[np.ndarray, "n 4"]
    acceleration_mm_s2: Float[np.ndarray, "n 3"]
    angular_velocity_camera_rad_s: Float[np.ndarray, "n 3"]
    wheel_angle_rad: Float[np.ndarray, "n wheels"]
    slip_mm_s: Float[np.ndarray, "n wheels"]
    wheels: WheelLog | None = None

    def sample_times_s(self, rate_hz: float) -> Float[np.ndarray, "m"]:
        """When a sensor of a given rate samples the drive: from its start to its end."""
        count = int(np.floor((self.time_s[-1] - self.time_s[0]) * rate_hz + 1e-9)) + 1
        return np.minimum(self.time_s[0] + np.arange(count) / rate_hz, self.time_s[-1])

    def pose_at(self, time_s: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 4 4"]:
        """`T_pipe_camera` at given times, cubic between samples for position and slerp for attitude.

        A time may lie outside the drive by the rounding of a stamp to nanoseconds.

        Raises:
            ValueError: for a time further outside the drive.
        """
        held_s = np.clip(time_s, self.time_s[0], self.time_s[-1])
        if np.max(np.abs(held_s - time_s), initial=0.0) > STAMP_STEP_S:
            raise ValueError(f"times from {self.time_s[0]} to {self.time_s[-1]} s only")
        rotation = Slerp(self.time_s, Rotation.from_quat(self.q_pipe_camera_wxyz[:, [1, 2, 3, 0]]))(held_s)
        return transform(rotation.as_matrix(), CubicSpline(self.time_s, self.position_mm)(held_s))


ARRAYS = [field.name for field in fields(Truth) if field.name not in ("pipe", "wheels")]


def gravity_direction(pipe: Pipe) -> Float[np.ndarray, "3"]:
    """Unit vector of gravity in the pipe frame at the pipe's start: +y when level, towards +z downhill."""
    slope = np.radians(pipe.inclination_deg)
    return np.array([0.0, np.cos(slope), np.sin(slope)])


def gravity_along(pipe: Pipe, z_mm: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """`gravity_direction` in the pipe frame at places along it, which a bend up or down turns."""
    start = gravity_direction(pipe)
    if not pipe.bends:
        return np.broadcast_to(start, (z_mm.size, 3))
    return np.einsum("nji,j->ni", pipe.axis.frame(z_mm)[:, :3, :3], start)


def save_truth(truth: Truth, folder: Path) -> None:
    """Write `truth.npz`, `wheels.npz` where there are wheels, and `pipe.json` into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "truth.npz", **{name: getattr(truth, name) for name in ARRAYS})
    if truth.wheels is not None:
        wheels = {field.name: getattr(truth.wheels, field.name) for field in fields(WheelLog)}
        np.savez_compressed(folder / "wheels.npz", **wheels)
    (folder / "pipe.json").write_text(truth.pipe.model_dump_json(indent=1))


def from_path(
    pipe: Pipe,
    time_s: Float[np.ndarray, "n"],
    position_mm: Float[np.ndarray, "n 3"],
    q_pipe_camera_wxyz: Float[np.ndarray, "n 4"],
    wheel_angle_rad: Float[np.ndarray, "n wheels"],
) -> Truth:
    """The truth of a prescribed path: velocities and accelerations are its derivatives."""
    place, rotation, R_pipe_world = position_mm, rotation_from_wxyz(q_pipe_camera_wxyz), None
    if pipe.bends:
        T_world_pipe = pipe.axis.frame(position_mm[:, 2])
        across = position_mm * [1.0, 1.0, 0.0]
        place = T_world_pipe[:, :3, 3] + np.einsum("nij,nj->ni", T_world_pipe[:, :3, :3], across)
        rotation, R_pipe_world = T_world_pipe[:, :3, :3] @ rotation, np.swapaxes(T_world_pipe[:, :3, :3], 1, 2)
    velocity = np.gradient(place, time_s, axis=0, edge_order=2)
    acceleration = np.gradient(velocity, time_s, axis=0, edge_order=2)
    if R_pipe_world is not None:
        acceleration = np.einsum("nij,nj->ni", R_pipe_world, acceleration)
    step = Rotation.from_matrix(np.swapaxes(rotation[:-1], -1, -2) @ rotation[1:]).as_rotvec()
    rate = step / np.diff(time_s)[:, None]
    middle = np.vstack([rate[:1], 0.5 * (rate[:-1] + rate[1:]), rate[-1:]])
    return Truth(
        pipe=pipe,
        time_s=time_s,
        position_mm=position_mm,
        q_pipe_camera_wxyz=q_pipe_camera_wxyz,
        acceleration_mm_s2=acceleration,
        angular_velocity_camera_rad_s=middle,
        wheel_angle_rad=wheel_angle_rad,
        slip_mm_s=np.zeros_like(wheel_angle_rad),
    )
