"""The optics of the sensor as settings: what wall, projector light, lens and image chip do to a picture."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from sensor_model.daylight import Daylight
from sensor_model.dirt import Dirt
from sensor_model.glass import Glass
from sensor_model.processing import Processing
from sensor_model.rig import Projector, load_settings
from sensor_model.settings import Settings
from sensor_model.water import Water

Share = Annotated[float, Field(ge=0, le=1)]
Channels = tuple[Share, Share, Share]
NonNegative = Annotated[float, Field(ge=0)]

LOOKS = Path(__file__).parent / "looks"
WALLS = Path(__file__).parent / "walls"
REFERENCE_RANGE_MM = 130.0  # fall-off with distance is 1 here


class WallFinish(Settings):
    """What the wall does with light beyond throwing it back evenly; zeros leave it matt."""

    gloss: Share = 0.0
    """Share that its surface mirrors where light comes straight on; 0.04 is bare plastic."""
    gloss_width_deg: Annotated[float, Field(gt=0.5, le=60)] = 12.0
    """Spread (standard deviation) of the slopes of a glossy surface: a highlight is twice as wide."""
    translucency: Share = 0.0
    """Share of the light that comes out of the wall beside where it went in."""
    translucency_mm: NonNegative = 0.8
    """How far beside (standard deviation)."""


AnyWall = Annotated[WallFinish, BeforeValidator(lambda wall: wall, json_schema_input_type=str | WallFinish)]


class NamedWall(Settings):
    """A wall as its file states it."""

    wall_reflectance: Channels
    wall: WallFinish


class Optics(Settings):
    """Every effect of the picture, each with its own setting and a zero (for `gamma`: a one) that switches it off.

    The first group acts where the picture is drawn, the second where it is exposed. Reflectance and the colours of the
    projector's light are no effects, and stay. Shares and noise are of full scale, in linear light.
    """

    wall_reflectance: Channels = (0.90, 0.84, 0.74)
    red_light: Channels = (1.0, 0.17, 0.13)
    yellow_light: Channels = (0.86, 0.78, 0.42)
    blue_light: Channels = (0.27, 0.36, 0.92)
    distance_power: NonNegative = 1.0
    """Light falls with this power of the distance from the projector; 2 is a bare point source."""
    angle_power: NonNegative = 1.0
    """Light falls with this power of the cosine between light and wall normal; 1 is Lambert's law."""
    slide_jag_deg: NonNegative = 0.08
    """Largest shift of a slit's edges along the azimuth: the print of the slide, the same in every picture."""
    slide_jag_cells: Annotated[int, Field(ge=16, le=4096)] = 1024
    """How many such shifts there are around the slide; between them an edge goes straight."""

    glass: Glass = Glass()
    water: Water = Water()
    wall: AnyWall = WallFinish()
    """Or the name of a wall, which sets `wall_reflectance` too."""
    lamp_level: NonNegative = 1.0
    """Of the projector's light, against that of other sources and the camera's noise."""
    daylight: Daylight = Daylight()
    dirt: Dirt = Dirt()
    inter_reflection: NonNegative = 0.15
    """Light that reaches the wall by way of the wall; 1 is a matt cylinder with the wall's own reflectance."""
    haze: Share = 0.06
    """Share of the light that lens and air scatter widely over the picture."""
    defocus_px: NonNegative = 1.3
    """Blur (standard deviation) at the far end of the picture's depth range; none at the focused depth."""
    focus_deg: NonNegative = 45.0
    """Angle from the optical axis at which a bore is in focus."""
    focus_mm: NonNegative = 0.0
    """Distance at which the wall is in focus: blur then goes with |1 / distance - 1 / focus|, up to `defocus_px`.

    0: by the angle alone and `focus_deg`, as if the camera were on the axis of a round bore.
    """
    color_bleed: Share = 0.18
    """Share of each channel that comes from the other two."""
    exposure: Annotated[float, Field(gt=0)] = 1.4
    shot_noise: NonNegative = 0.012
    """Standard deviation at full scale; it falls with the root of the light."""
    read_noise: NonNegative = 0.003
    gamma: Annotated[float, Field(ge=1, le=3)] = 2.4
    """Tone curve: stored value = light to the power of 1 / gamma."""
    lost_bits: Annotated[int, Field(ge=0, le=6)] = 0
    """Bits of quantisation lost beyond the eight of the file."""
    processing: Processing = Processing()

    @model_validator(mode="before")
    @classmethod
    def _named_wall(cls, data: Any) -> Any:
        named = isinstance(data, dict) and isinstance(data.get("wall"), str)
        return {**data, **_wall(data["wall"])} if named else data

    @classmethod
    def ideal(cls) -> Optics:
        """Every effect off: matt white wall, evenly lit, a perfect lens and chip."""
        off = dict.fromkeys(
            ("distance_power", "angle_power", "slide_jag_deg", "inter_reflection", "haze", "defocus_px", "color_bleed"),
            0.0,
        )
        white = (1.0, 1.0, 1.0)
        return cls(wall_reflectance=white, shot_noise=0, read_noise=0, exposure=1, gamma=1, **off)

    def noiseless(self) -> Optics:
        """The same optics without the two noises that differ from picture to picture."""
        return self.model_copy(update={"shot_noise": 0.0, "read_noise": 0.0})


@cache
def look(name: str = "endoscope") -> Optics:
    """The optics of a real sensor, as measured in its pictures, by name.

    Raises:
        ValueError: for another name.
    """
    known = {path.stem: path for path in sorted(LOOKS.glob("*.yaml"))}
    if name not in known:
        raise ValueError(f"no look is called {name!r}; there are {', '.join(known)}")
    return load_settings(Optics, known[name])


@cache
def _wall(name: str) -> dict[str, Any]:
    """What a named wall states of the optics.

    Raises:
        ValueError: for another name.
    """
    known = {path.stem: path for path in sorted(WALLS.glob("*.yaml"))}
    if name not in known:
        raise ValueError(f"no wall is called {name!r}; there are {', '.join(known)}")
    stated = load_settings(NamedWall, known[name])
    return {"wall_reflectance": stated.wall_reflectance, "wall": stated.wall}


def wall_name(optics: Optics) -> str | None:
    """Which named wall these optics have; None for a wall of their own."""
    own = {"wall_reflectance": optics.wall_reflectance, "wall": optics.wall}
    return next((path.stem for path in sorted(WALLS.glob("*.yaml")) if _wall(path.stem) == own), None)


def _by_name(value: Any) -> Any:
    return look(value) if isinstance(value, str) else value


AnyOptics = Annotated[Optics, BeforeValidator(_by_name, json_schema_input_type=str | Optics)]


class Light(NamedTuple):
    """The projector's light as compiled code and the shader read it; half angles as tangents.

    Tuples, not arrays: compiled code counts references to an array at every call.
    """

    lit_from: tuple[float, ...]  # tangent where each band's light begins
    lit_to: tuple[float, ...]  # and ends
    colors: tuple[tuple[float, ...], ...]  # of each band, wall reflectance times light
    lights: tuple[tuple[float, ...], ...]  # of each band, what a mirror throws back
    jag_rad: float
    jag_cells: int
    strut_azimuth_rad: float
    strut_half_width_rad: float
    strut_softness_rad: float
    housing_radius_mm: float
    distance_power: float
    angle_power: float
    gloss: float
    gloss_power: float
    translucency: float
    translucency_mm: float


def light(projector: Projector, optics: Optics) -> Light:
    """What leaves the projector, band by band."""
    half_slit = np.radians(projector.slit_width_deg) / 2
    slits = projector.slit_half_angles_rad
    inner, outer = np.radians([projector.inner_half_angle_deg, projector.outer_half_angle_deg])
    by_letter = {"R": optics.red_light, "Y": optics.yellow_light, "B": optics.blue_light}
    lights = np.array([by_letter[letter] for letter in projector.band_colors]) * optics.lamp_level
    wall = optics.wall
    return Light(
        tuple(np.tan([inner, *(slits + half_slit)]).tolist()),
        tuple(np.tan([*(slits - half_slit), outer]).tolist()),
        tuple(tuple(color) for color in (lights * optics.wall_reflectance).tolist()),
        tuple(tuple(color) for color in lights.tolist()),
        float(np.radians(optics.slide_jag_deg)),
        optics.slide_jag_cells,
        float(np.radians(projector.strut_clock_deg)),
        float(np.radians(projector.strut_width_deg)) / 2,
        float(np.radians(projector.strut_softness_deg)),
        projector.housing_radius_mm,
        optics.distance_power,
        optics.angle_power,
        wall.gloss,
        2.0 / np.radians(wall.gloss_width_deg) ** 2,
        wall.translucency,
        wall.translucency_mm,
    )
