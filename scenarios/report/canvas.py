"""How every picture of the report is made: one style, and the same bytes whenever it is drawn again."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import UInt8

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 160
WIDTH_IN = 10.0
COLORS = 256
JPEG_QUALITY = 76
# Okabe and Ito's colours, which colour-blind readers can tell apart
BLACK, ORANGE, SKY, GREEN, BLUE, VERMILION, PURPLE = (
    "#222222",
    "#e69f00",
    "#56b4e9",
    "#009e73",
    "#0072b2",
    "#d55e00",
    "#cc79a7",
)
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
UNSEEN, HATCH = "#e2e2e2", "#bdbdbd"
STYLE = {
    "font.size": 10,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#777777",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "hatch.color": HATCH,
    "hatch.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.4,
}


class Picture(NamedTuple):
    """One picture of the page: its file, what it shows in words for who cannot see it, and its caption."""

    file: bytes
    kind: str
    width_px: int
    height_px: int
    alt: str
    caption: str

    @property
    def source(self) -> str:
        """The file inside an address, so that the page needs no other file."""
        return f"data:image/{self.kind};base64,{b64encode(self.file).decode()}"


@contextmanager
def drawing(height_in: float, width_in: float = WIDTH_IN) -> Iterator[Figure]:
    """An empty figure in the report's style, whatever style the machine has."""
    import matplotlib.style
    from matplotlib.figure import Figure

    with matplotlib.style.context(["default", STYLE]):
        yield Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")


def to_picture(figure: Figure, alt: str, caption: str, shaded: bool = False) -> Picture:
    """The figure as a PNG of few colours, or a JPEG where it is shaded; without date or version."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    rgb = np.array(canvas.buffer_rgba())[:, :, :3]
    if shaded:
        return photograph(rgb, alt, caption)
    small = Image.fromarray(rgb).quantize(COLORS, dither=Image.Dither.NONE)
    file = BytesIO()
    small.save(file, format="PNG", optimize=True)
    return Picture(file.getvalue(), "png", *small.size, alt, caption)


def photograph(rgb: UInt8[np.ndarray, "height width 3"], alt: str, caption: str) -> Picture:
    """A camera's picture as a JPEG."""
    from PIL import Image

    file = BytesIO()
    Image.fromarray(rgb).save(file, format="JPEG", quality=JPEG_QUALITY, optimize=True)
    return Picture(file.getvalue(), "jpeg", rgb.shape[1], rgb.shape[0], alt, caption)


def clock_axis(axes: Axes, step_hours: int = 3) -> None:
    """Clock positions down the vertical axis, which counts degrees: 12 o'clock at the top and again at the bottom."""
    hours = range(0, 13, step_hours)
    axes.set_ylim(360, 0)
    axes.set_yticks([30 * hour for hour in hours], [f"{hour or 12}:00" for hour in hours])
    axes.set_ylabel("clock position (h:mm)")


def hatch_unseen(axes: Axes) -> None:
    """Make the ground of a plot say 'not seen'."""
    axes.set_facecolor(UNSEEN)
    axes.patch.set_hatch("////")
    axes.patch.set_edgecolor(HATCH)
