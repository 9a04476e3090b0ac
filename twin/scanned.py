"""A bore as it was scanned: its radius on a grid of cells, linear between their middles."""

from __future__ import annotations

import zlib
from base64 import b64decode, b64encode
from binascii import Error as NoBase64
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit, types
from numba.extending import overload
from pydantic import Field, model_validator

from sensor_model.settings import Settings
from twin.features.base import CENTER_Z, HALF_BOX_ARC, HALF_BOX_Z, ROW_LENGTH

SCANNED = -4  # beside the codes of joints, debris and tapers
MOST_CELLS = 1_000_000
LONGEST_TEXT = 2_800_000
STEP_MM = 0.001
FADE_MM = 20.0  # beyond its ends a scan fades into the nominal bore


class Scan(NamedTuple):
    """A scan as compiled code reads it: radii less the nominal bore's, the first cells' middle and a cell's length."""

    grid: np.ndarray
    first_z: float
    cell_z: float


class ScannedWall(Settings):
    """The bore from a scan: `file` alone is written by hand, and lies beside the scenario's file.

    What the file held stands in `cells` once a scenario is loaded, so that a run's folder needs no other file: offsets
    from `middle_radius_mm` in micrometres (16 bits, little-endian, a row around the wall), packed by zlib and base64.
    """

    file: Annotated[str, Field(min_length=1, max_length=255)]
    first_z_mm: float = 0.0
    cell_z_mm: Annotated[float, Field(gt=0, le=20)] = 1.0
    around: Annotated[int, Field(ge=0, le=7200)] = 0
    along: Annotated[int, Field(ge=0, le=MOST_CELLS)] = 0
    middle_radius_mm: Annotated[float, Field(ge=0)] = 0.0
    cells: Annotated[str, Field(max_length=LONGEST_TEXT)] = ""

    @model_validator(mode="after")
    def _holds_its_cells(self) -> ScannedWall:
        if not self.cells:
            raise ValueError("holds no cells: they are read from its file when a scenario file is loaded")
        if self.around < 8 or self.along < 2 or self.around * self.along > MOST_CELLS:
            raise ValueError(f"needs at least 8 x 2 cells and at most {MOST_CELLS}")
        if self.radius_mm.min() <= 0:
            raise ValueError("a radius must be greater than 0")
        return self

    @cached_property
    def radius_mm(self) -> Float[np.ndarray, "around along"]:
        """The radius at every cell's middle."""
        size = 2 * self.around * self.along
        try:
            unpacked = zlib.decompressobj()
            raw = unpacked.decompress(b64decode(self.cells, validate=True), size)  # never more than was promised
        except (NoBase64, zlib.error) as error:
            raise ValueError(f"cells cannot be unpacked: {error}") from error
        if len(raw) != size or unpacked.unconsumed_tail:
            raise ValueError(f"cells must unpack to {size} bytes")
        offsets = np.frombuffer(raw, "<i2").reshape(self.around, self.along)
        return self.middle_radius_mm + STEP_MM * offsets

    def row(self) -> np.ndarray:
        """Where the scan lies, as a box of the compiled wall; it adds no depth of its own."""
        row = np.zeros(ROW_LENGTH)
        half = (self.along - 1) * self.cell_z_mm / 2
        row[[CENTER_Z, HALF_BOX_Z, HALF_BOX_ARC]] = self.first_z_mm + half, half + FADE_MM, 1e9
        return row

    def scan(self, bore_radius_mm: float) -> Scan:
        """The scan as compiled code reads it."""
        return Scan(self.radius_mm - bore_radius_mm, self.first_z_mm, self.cell_z_mm)


def scanned_wall(
    file: str, first_z_mm: float, cell_z_mm: float, radius_mm: Float[np.ndarray, "around along"]
) -> ScannedWall:
    """Settings that hold a grid of radii, to a micrometre.

    Raises:
        ValueError: for a grid that is too large or spans more than 65 mm.
    """
    middle = float(np.round((radius_mm.min() + radius_mm.max()) / 2, 3))
    offsets = np.round((radius_mm - middle) / STEP_MM)
    if np.abs(offsets).max() > np.iinfo(np.int16).max:
        raise ValueError(f"radii from {radius_mm.min():.1f} to {radius_mm.max():.1f} mm; at most 65 mm may lie between")
    cells = b64encode(zlib.compress(offsets.astype("<i2").tobytes(), 9)).decode()
    around, along = radius_mm.shape
    return ScannedWall(
        file=file,
        first_z_mm=first_z_mm,
        cell_z_mm=cell_z_mm,
        around=around,
        along=along,
        middle_radius_mm=middle,
        cells=cells,
    )


def scanned_depth_mm(scan: Scan | None, theta: float, z: float) -> float:
    """The scan's radius less the nominal bore's at one place, mm; 0 without a scan.

    Compiled code has a version for each of the two, so that a pipe without a scan pays nothing for it.
    """
    return 0.0 if scan is None else _between_cells(scan, theta, z)


@overload(scanned_depth_mm, inline="always")
def _scanned_depth_mm(scan, theta, z):  # noqa: ARG001  numba reads the names
    if isinstance(scan, types.NoneType):
        return lambda scan, theta, z: 0.0  # noqa: ARG005
    return lambda scan, theta, z: _between_cells(scan, theta, z)


@njit(cache=True, error_model="numpy")
def _between_cells(scan, theta, z):
    """Linear between four cells; they join around the wall, and beyond the scan's ends it fades out."""
    around, along = scan.grid.shape
    place = theta / (2.0 * np.pi) * around - 0.5
    low = np.floor(place)
    i, share = int(low) % around, place - low
    after = i + 1 if i + 1 < around else 0
    at = (z - scan.first_z) / scan.cell_z
    beyond = max(-at, at - (along - 1), 0.0) * scan.cell_z
    if beyond >= FADE_MM:
        return 0.0
    at = min(max(at, 0.0), along - 1.0)
    j = min(int(at), along - 2)
    part = at - j
    near = (1.0 - part) * scan.grid[i, j] + part * scan.grid[i, j + 1]
    far = (1.0 - part) * scan.grid[after, j] + part * scan.grid[after, j + 1]
    return ((1.0 - share) * near + share * far) * (1.0 - beyond / FADE_MM)
