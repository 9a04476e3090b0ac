"""Registration methods: one file each, one line here; each is settings plus one verb, `align`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from algorithms.registration import cylinder, cylinder_map, cylinder_variance, ellipsoid, gicp, icp, icp_axis, vgicp
from algorithms.registration.cylinder import CylinderSettings
from algorithms.registration.cylinder_map import CylinderMapSettings
from algorithms.registration.cylinder_variance import CylinderVarianceSettings
from algorithms.registration.ellipsoid import EllipsoidSettings
from algorithms.registration.gicp import GicpSettings
from algorithms.registration.icp import IcpSettings
from algorithms.registration.icp_axis import IcpAxisSettings
from algorithms.registration.vgicp import VgicpSettings
from algorithms.types import Alignment


class Registration(NamedTuple):
    """A method: its settings and its verb, `align(points, wall, prior, settings)`, which gives the posterior.

    One that registers against the wall seen so far keeps a map of it: `begin(settings)` makes an empty one, and
    `grow(seen, points, alignment)` puts a registered frame into it.
    """

    settings: type[Any]
    align: Callable[..., Alignment]
    begin: Callable[..., Any] | None = None
    grow: Callable[..., None] | None = None


REGISTRATIONS = {
    "cylinder": Registration(CylinderSettings, cylinder.align),
    "cylinder-map": Registration(CylinderMapSettings, cylinder_map.align),
    "cylinder-variance": Registration(CylinderVarianceSettings, cylinder_variance.align),
    "ellipsoid": Registration(EllipsoidSettings, ellipsoid.align),
    "icp": Registration(IcpSettings, icp.align, icp.begin, icp.grow),
    "icp-axis": Registration(IcpAxisSettings, icp_axis.align, icp_axis.begin, icp_axis.grow),
    "gicp": Registration(GicpSettings, gicp.align, gicp.begin, gicp.grow),
    "vgicp": Registration(VgicpSettings, vgicp.align, vgicp.begin, vgicp.grow),
}

AnyRegistration = Annotated[
    CylinderSettings
    | CylinderMapSettings
    | CylinderVarianceSettings
    | EllipsoidSettings
    | IcpSettings
    | IcpAxisSettings
    | GicpSettings
    | VgicpSettings,
    Field(discriminator="kind"),
]
