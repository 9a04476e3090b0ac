"""Pictures of logs as RGB and as PNG, looked at before they are unpacked: a small file can hold a huge picture."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import UInt8

from sensor_model.rig import Camera
from sensor_model.sense import png

ENCODINGS = {"rgb8": slice(None), "bgr8": slice(None, None, -1)}
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"


def png_of(data: bytes, camera: Camera) -> bytes:
    """A packed picture as PNG, which one is already.

    Raises:
        ValueError: for a picture of another kind or size.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(BytesIO(data), formats=("PNG", "JPEG")) as picture:  # only the header is read yet
            if picture.size != (camera.width_px, camera.height_px):
                wanted = f"{camera.width_px} x {camera.height_px}"
                raise ValueError(f"a picture of {picture.width} x {picture.height} px; the rig's camera has {wanted}")
            if picture.format == "PNG" and picture.mode == "RGB":
                return data
            return png(np.array(picture.convert("RGB")))
    except (UnidentifiedImageError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"not a PNG or JPEG that can be read: {error}") from error


def rgb_of(message: Any) -> UInt8[np.ndarray, "height width 3"]:
    """The picture of a sensor_msgs/Image.

    Raises:
        ValueError: for another encoding, or other lengths than it states.
    """
    if message.encoding not in ENCODINGS:
        raise ValueError(f"encoding {message.encoding[:40]!r}; one of {', '.join(ENCODINGS)} is expected")
    height, width, step = int(message.height), int(message.width), int(message.step)
    if step < 3 * width or message.data.size != height * step:
        raise ValueError(f"{message.data.size} bytes for {height} rows of {step}, {width} pixels each")
    rows = message.data.reshape(height, step)[:, : 3 * width].reshape(height, width, 3)
    return np.ascontiguousarray(rows[:, :, ENCODINGS[message.encoding]])
