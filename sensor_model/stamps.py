"""When frames are exposed and what their stamps say: latency between camera and IMU, jitter, lost frames, strobe."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.settings import Settings
from twin.truth import Truth

JITTER_SIGMAS = 3.0
STROBE_POSES = 3


class Timing(Settings):
    """Errors of the camera's clock against the IMU's; every one has a zero.

    A frame was exposed `camera_latency_ms` before its stamp, give or take `stamp_jitter_ms` (one standard deviation,
    cut at three). `dropped_share` of the frames, but not the first, are lost. The robot moves on while the strobe of
    `strobe_ms` burns: a picture is the mean over it, and slit pixels are those of its middle.
    """

    camera_latency_ms: Annotated[float, Field(ge=0, le=500)] = 0.0
    stamp_jitter_ms: Annotated[float, Field(ge=0, le=20)] = 0.0
    dropped_share: Annotated[float, Field(ge=0, le=0.95)] = 0.0
    strobe_ms: Annotated[float, Field(ge=0, le=20)] = 0.0


def stamps_and_exposures_s(
    truth: Truth, rate_hz: float, timing: Timing, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "frames"], Float[np.ndarray, "frames poses"]]:
    """The stamp of every frame that is kept, and the times of the poses that its exposure is made of.

    Raises:
        ValueError: when jitter could swap two frames.
    """
    stamp_s = truth.sample_times_s(rate_hz)
    if 2 * JITTER_SIGMAS * timing.stamp_jitter_ms * 1e-3 >= 1 / rate_hz:
        raise ValueError(
            f"stamp_jitter_ms of {timing.stamp_jitter_ms:g} can swap frames at {rate_hz:g} Hz; "
            f"less than {1e3 / rate_hz / (2 * JITTER_SIGMAS):.3g} ms is needed"
        )
    jitter = np.clip(rng.standard_normal(stamp_s.size), -JITTER_SIGMAS, JITTER_SIGMAS) * timing.stamp_jitter_ms
    kept = rng.random(stamp_s.size) >= timing.dropped_share
    kept[0] = True
    middle = stamp_s - 1e-3 * (timing.camera_latency_ms + jitter)
    within = np.linspace(-0.5, 0.5, STROBE_POSES) if timing.strobe_ms > 0 else np.zeros(1)
    exposed = np.clip(middle[:, None] + 1e-3 * timing.strobe_ms * within, truth.time_s[0], truth.time_s[-1])
    return stamp_s[kept], exposed[kept]
