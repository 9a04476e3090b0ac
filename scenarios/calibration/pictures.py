"""Pictures from strangers: bounded, read whole or refused with the reason."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from scenarios.document import BadInput

LARGEST_BYTES, LARGEST_SIDE_PX, LEAST_SIDE_PX = 64 * 2**20, 8192, 64
MOST_PICTURES = 1000
ENDINGS = {".png", ".jpg", ".jpeg"}
WANTED = "give a PNG or JPEG"


def read_picture(file: Path) -> UInt8[np.ndarray, "height width 3"]:
    """A picture, RGB.

    Raises:
        BadInput: naming the file and what is wrong with it.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        if not file.is_file():
            raise BadInput([f"{file}: {'is no plain file' if file.exists() else 'no such file'}; {WANTED}"])
        if file.stat().st_size > LARGEST_BYTES:
            raise BadInput([f"{file}: got more than {LARGEST_BYTES / 2**20:g} MiB; {WANTED} that is smaller"])
        with Image.open(file, formats=("PNG", "JPEG")) as picture:
            # the header first: a small file can unpack to a huge picture
            if not LEAST_SIDE_PX <= min(picture.size) <= max(picture.size) <= LARGEST_SIDE_PX:
                sides = f"{LEAST_SIDE_PX} to {LARGEST_SIDE_PX} px"
                raise BadInput([f"{file}: got {picture.size[0]} x {picture.size[1]} px; a side must be {sides}"])
            return np.asarray(picture.convert("RGB"))
    except UnidentifiedImageError as error:
        raise BadInput([f"{file}: is no picture that can be read; {WANTED}"]) from error
    except Image.DecompressionBombError as error:
        raise BadInput([f"{file}: unpacks to too large a picture; {WANTED} that is smaller"]) from error
    except (OSError, ValueError, SyntaxError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise BadInput([f"{file}: is no picture that can be read whole: {why}; {WANTED}"]) from error


def gray(picture: UInt8[np.ndarray, "height width 3"]) -> UInt8[np.ndarray, "height width"]:
    """Its brightness."""
    import cv2

    return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)


def listed(paths: list[Path]) -> list[Path]:
    """The files named, and the pictures of the folders named, in order.

    Raises:
        BadInput: for too many, or a folder without pictures.
    """
    files = [file for path in paths for file in _of(path)]
    if len(files) > MOST_PICTURES:
        raise BadInput([f"{paths[0]}: got {len(files)} pictures; at most {MOST_PICTURES} are taken"])
    return files


def _of(path: Path) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    inside = sorted(file for file in path.iterdir() if file.suffix.lower() in ENDINGS)
    if not inside:
        raise BadInput([f"{path}: holds no picture; {WANTED}"])
    yield from inside
