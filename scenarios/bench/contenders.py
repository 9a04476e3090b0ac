"""Who takes part in a bench over whole scans: a label and settings for each way of registering."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from algorithms.registration.cylinder import CylinderSettings
from algorithms.registration.cylinder_map import CylinderMapSettings
from algorithms.registration.ellipsoid import EllipsoidSettings
from algorithms.registration.gicp import GicpSettings
from algorithms.registration.icp import IcpSettings
from algorithms.registration.vgicp import VgicpSettings

ELLIPSOID, ICP_PLANE, ICP_CYLINDER = "ellipsoid", "icp, plane start", "icp, cylinder start"
CYLINDER, OURS = "cylinder", "cylinder-map"
METHODS: dict[str, Any] = {
    ELLIPSOID: EllipsoidSettings(),
    ICP_PLANE: IcpSettings(start="plane"),
    ICP_CYLINDER: IcpSettings(),
    CYLINDER: CylinderSettings(),
    OURS: CylinderMapSettings(),
}
PEERS: dict[str, Any] = {"gicp": GicpSettings(), "vgicp": VgicpSettings()}


def contenders() -> dict[str, Any]:
    """Those of section 4.2 and ours, and where small_gicp is installed its two."""
    return METHODS | (PEERS if find_spec("small_gicp") else {})
