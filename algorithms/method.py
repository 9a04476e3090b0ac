"""The settings of every stage of the measurement in one frozen object: what tuning exports and the robot loads."""

from __future__ import annotations

from sensor_model.settings import Settings


class Method(Settings):
    """One way to measure."""
