"""Registration methods: one file each, one line here; each is settings plus one verb, `align`."""

from __future__ import annotations

from collections.abc import Callable

from algorithms.registration import cylinder
from algorithms.registration.cylinder import CylinderSettings
from algorithms.types import Alignment

Align = Callable[..., Alignment]

REGISTRATIONS: dict[str, tuple[type[CylinderSettings], Align]] = {
    "cylinder": (CylinderSettings, cylinder.align),
}
