"""Distance by integrating the accelerometer twice, which the paper warns of: the negative control."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.localisation import paper
from algorithms.localisation.imu import along_axis_mm_s2
from algorithms.localisation.paper import Odometry, RollSettings, moved
from algorithms.types import Alignment
from sensor_model.recording import Frame, NominalPipe
from sensor_model.rig import Rig

Positive = Annotated[float, Field(gt=0)]


class AccelSettings(RollSettings):
    """What the accelerometer along the pipe is held to be worth; the bias takes in what is not known of the slope."""

    kind: Literal["accel"] = "accel"
    accelerometer_noise_density: Positive = 1.5e-3
    accelerometer_bias_m_s2: Positive = 0.05


@dataclass(frozen=True)
class Dead:
    """Dead reckoning: the odometry that the frames see, distance, speed and bias with covariance, the first force."""

    odometry: Odometry
    x: Float[np.ndarray, "3"]
    P: Float[np.ndarray, "3 3"]
    at_rest_mm_s2: float


def launch(
    frame: Frame, rig: Rig, pipe: NominalPipe, axis_camera: Float[np.ndarray, "3"], settings: AccelSettings
) -> Dead:
    """The start of the log, at rest: what is felt along the pipe then is slope and bias."""
    std = np.array([paper.LAUNCH_STD_MM, 1.0, 1e3 * settings.accelerometer_bias_m_s2])
    felt = along_axis_mm_s2(frame, rig, axis_camera)
    odometry = paper.launch(frame, rig, pipe, axis_camera, settings)
    return Dead(odometry, np.zeros(3), np.diag(std**2), 0.0 if felt is None else felt)


def advance(dead: Dead, frame: Frame, rig: Rig, settings: AccelSettings) -> Dead:
    """One frame on, by the acceleration felt since the last; without a sample the speed stays."""
    from filterpy.kalman import predict

    dt = (frame.stamp_ns - dead.odometry.stamp_ns) / 1e9
    felt = along_axis_mm_s2(frame, rig, dead.odometry.axis_camera)
    u = 0.0 if felt is None else felt - dead.at_rest_mm_s2
    F = np.array([[1.0, dt, -(dt**2) / 2], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    way = np.array([dt / 2, 1.0, 0.0])
    noise = 1e3 * settings.accelerometer_noise_density * np.sqrt(dt)
    x, P = predict(
        dead.x, dead.P, F=F, Q=noise**2 * np.outer(way, way), u=np.array([u]), B=np.array([[dt**2 / 2], [dt], [0.0]])
    )
    odometry = moved(dead.odometry, frame, rig, settings, float(x[0]), float(np.sqrt(P[0, 0])))
    return replace(dead, odometry=odometry, x=np.asarray(x), P=np.asarray(P))


def settle(dead: Dead, alignment: Alignment) -> Dead:
    """Remember axis and centre."""
    return replace(dead, odometry=paper.settle(dead.odometry, alignment))


def predict(dead: Dead) -> Alignment:
    """The prior of a frame."""
    return paper.predict(dead.odometry)
