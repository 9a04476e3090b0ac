"""What the measurement believes of the sensor: camera, projector cones and colours, IMU mount, wheels."""

from __future__ import annotations

from functools import cache, cached_property
from itertools import pairwise
from math import hypot
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import Field, field_validator, model_validator

from sensor_model.geometry import cone_frame, rotation_from_wxyz, transform
from sensor_model.plain_yaml import plain_data
from sensor_model.settings import Settings

Color = Literal["R", "Y", "B"]
Within = Annotated[float, Field(ge=-1e4, le=1e4)]  # beyond it squares and products lose all meaning
Vector3 = tuple[Within, Within, Within]
AnySettings = TypeVar("AnySettings", bound=Settings)
MAX_SETTINGS_BYTES = 2**20
QUATERNION_TOLERANCE = 0.05
RIGS = Path(__file__).parent / "rigs"


class Camera(Settings):
    """Kannala-Brandt fisheye as OpenCV has it; pixel centres at integers."""

    width_px: Annotated[int, Field(ge=64, le=8192)]
    height_px: Annotated[int, Field(ge=64, le=8192)]
    fx_px: Annotated[float, Field(gt=0, le=1e5)]
    fy_px: Annotated[float, Field(gt=0, le=1e5)]
    skew_px: Within
    cx_px: Within
    cy_px: Within
    k1: Within
    k2: Within
    k3: Within
    k4: Within

    @cached_property
    def intrinsics(self) -> Float[np.ndarray, "9"]:
        """fx, fy, skew, cx, cy, k1 .. k4, as `geometry.fisheye_project` takes them."""
        return np.array(
            [self.fx_px, self.fy_px, self.skew_px, self.cx_px, self.cy_px, self.k1, self.k2, self.k3, self.k4]
        )


class Slit(Settings):
    """One dark slit between two colour bands: a cone of light that is missing."""

    name: Annotated[str, Field(pattern="^[RYB][RYB]$")]
    half_angle_deg: Annotated[float, Field(gt=1, lt=80)]
    jag_deg: Annotated[tuple[Annotated[float, Field(gt=-2, lt=2)] | None, ...], Field(max_length=3600)] = ()
    """The slide's own jaggedness, as calibrated: what the half angle has beyond its mean, evenly around the slide.

    The first value is of the cell that begins at 12 o'clock; they go clockwise. None: what was not learned, from which
    no point is made. Empty: a smooth cone.
    """
    apex_mm: Annotated[Vector3 | None, Field(exclude_if=lambda apex: apex is None)] = None
    """Where this slit's light seems to come from, if not from the projector's apex: a glass tube moves it."""


class Projector(Settings):
    """Concentric colour bands with dark slits between them; every slit is a cone about one axis from one apex."""

    apex_mm: Vector3
    axis: Vector3
    slits: Annotated[tuple[Slit, ...], Field(min_length=1, max_length=64)]
    slit_width_deg: Annotated[float, Field(gt=0, le=2)]
    inner_half_angle_deg: Annotated[float, Field(gt=0)]
    outer_half_angle_deg: Annotated[float, Field(lt=80)]
    strut_clock_deg: float
    strut_width_deg: Annotated[float, Field(ge=0, lt=180)]
    strut_softness_deg: Annotated[float, Field(ge=0, lt=20)]
    housing_radius_mm: Annotated[float, Field(ge=0)]

    @model_validator(mode="after")
    def _in_order(self) -> Projector:
        if not self.axis[2] > 0:
            raise ValueError(f"axis must point ahead, its z above 0; got {self.axis[2]:g}")
        angles = [self.inner_half_angle_deg, *(s.half_angle_deg for s in self.slits), self.outer_half_angle_deg]
        if any(b - a <= self.slit_width_deg for a, b in pairwise(angles)):
            raise ValueError(
                "slits must go outward, further apart than slit_width_deg, inside the inner and outer angle"
            )
        if len({len(s.jag_deg) for s in self.slits}) > 1:
            raise ValueError("jag_deg must have as many values for every slit, or none")
        names = [s.name for s in self.slits]
        if any(a[1] != b[0] for a, b in pairwise(names)):
            raise ValueError("a slit's outer colour must be the next slit's inner colour")
        if len(set(names)) != len(names):
            raise ValueError("two slits with the same colour pair cannot be told apart")
        return self

    @property
    def band_colors(self) -> str:
        """Colour of each band from the inside out, one letter each; one more than there are slits."""
        return self.slits[0].name[0] + "".join(s.name[1] for s in self.slits)

    @cached_property
    def slit_half_angles_rad(self) -> Float[np.ndarray, "slits"]:
        """Half angle of every slit's centre line."""
        return np.radians([s.half_angle_deg for s in self.slits])

    @cached_property
    def slit_tangents(self) -> Float[np.ndarray, "2 slits"]:
        """Tangents between which light passes as each slit's: within a width of it, and no nearer to a neighbour."""
        angles, width = self.slit_half_angles_rad, np.radians(self.slit_width_deg)
        between = 0.5 * (angles[:-1] + angles[1:])
        begin = np.append(0.0, between).clip(min=angles - width)
        return np.tan([begin, np.append(between, 1.5).clip(max=angles + width)])

    @cached_property
    def jag_table_rad(self) -> Float[np.ndarray, "slits cells"]:
        """What the half angle of every slit has beyond its mean, by azimuth from 12 o'clock; no cells: smooth cones.

        NaN where it is not known.
        """
        table = np.array([s.jag_deg for s in self.slits], dtype=float)  # None becomes NaN
        return np.radians(table).reshape(len(self.slits), -1)

    @cached_property
    def printed_jag_rad(self) -> Float[np.ndarray, "slits cells"]:
        """`jag_table_rad` as it is drawn: smooth where it is not known."""
        return np.nan_to_num(self.jag_table_rad)

    def of_slit(self, slit: int) -> Projector:
        """The projector whose only apex is that of one of its slits."""
        plain = tuple(one.model_copy(update={"apex_mm": None}) for one in self.slits)
        return self.model_copy(update={"apex_mm": self.slits[slit].apex_mm or self.apex_mm, "slits": plain})

    @cached_property
    def T_camera_projector(self) -> Float[np.ndarray, "4 4"]:
        """Projector frame: origin at the apex, z along the axis, x and y as near the camera's as can be."""
        return transform(cone_frame(np.array(self.axis)), np.array(self.apex_mm))


class ImuMount(Settings):
    """Where the IMU sits, as seen from the camera."""

    position_camera_mm: Vector3
    q_camera_imu_wxyz: tuple[float, float, float, float]

    @field_validator("q_camera_imu_wxyz")
    @classmethod
    def _of_length_1(cls, q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        if abs(hypot(*q) - 1) > QUATERNION_TOLERANCE:
            raise ValueError(f"a quaternion of length {hypot(*q):.3g}; 1 is expected")
        return q

    @cached_property
    def R_camera_imu(self) -> Float[np.ndarray, "3 3"]:
        """R_cal of section 3.2.1: carries IMU coordinates to the camera's."""
        return rotation_from_wxyz(np.array(self.q_camera_imu_wxyz))


class Wheels(Settings):
    """The encoder wheels: what Eq. 25 needs of them."""

    diameters_mm: Annotated[tuple[Annotated[float, Field(gt=0, le=1e4)], ...], Field(min_length=1, max_length=16)]
    counts_per_turn: Annotated[int, Field(gt=0, le=10**9)]  # 7 PPR x 4 x 603 (section 3.3)


class Rig(Settings):
    """One sensor, calibrated; in a run the true one makes the pictures and the nominal one goes with the recording."""

    camera: Camera
    projector: Projector
    imu: ImuMount
    wheels: Wheels


def save_settings(settings: Settings, path: Path) -> None:
    """Write settings as YAML."""
    from ruamel.yaml import YAML

    with path.open("w") as file:
        YAML(typ="safe", pure=True).dump(settings.model_dump(mode="json"), file)


def load_settings(kind: type[AnySettings], path: Path) -> AnySettings:
    """Read settings of a kind from YAML.

    Raises:
        OSError: for a file that cannot be opened.
        ValueError: for a file that says something else.
    """
    if path.stat().st_size > MAX_SETTINGS_BYTES:
        raise ValueError(f"{path.stat().st_size} bytes; at most {MAX_SETTINGS_BYTES}")
    if not path.is_file():  # a pipe would be waited for
        raise ValueError("is no plain file")
    return kind.model_validate(plain_data(path.read_text()))


def rigs() -> dict[str, Path]:
    """The rigs that come with pipetwin, by name."""
    return {path.stem: path for path in sorted(RIGS.glob("*.yaml"))}


@cache
def preset_rig(name: str = "endoscope") -> Rig:
    """One of the rigs that come with pipetwin.

    Raises:
        ValueError: for another name.
    """
    if name not in rigs():
        raise ValueError(f"no rig is called {name!r}; there are {', '.join(rigs())}")
    return load_settings(Rig, rigs()[name])
