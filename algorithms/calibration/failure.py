"""What a calibration says when there is none."""

from __future__ import annotations


class CannotCalibrate(ValueError):
    """The pictures or the log do not determine what is asked for; the message says why."""
