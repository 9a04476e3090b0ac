"""The six-wheel robot of section 3.3: its settings and its MuJoCo model."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from sensor_model.settings import Settings


class Robot(Settings):
    """The robot: three sprung legs with two driven omni wheels in tandem each, and two end wheels that turn it."""

    leg_count: int = 3
    wheel_radius_mm: Annotated[float, Field(gt=2)] = 19.0
