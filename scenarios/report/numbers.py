"""Numbers as the report prints them."""

from __future__ import annotations

from math import isfinite

NONE = "n/a"
UNITS = {"mm2": "mm²", "mm": "mm", "deg": "°", "pct": "%"}
FINEST_MM = 0.01
SHARES = {"not_seen_share", "decode_yield", "wrong_words", "seen_share"}


def fixed(value: float | None, decimals: int) -> str:
    """A number with so many decimals."""
    return NONE if value is None or not isfinite(value) else _minus(f"{value:.{decimals}f}")


def signed(value: float | None, decimals: int) -> str:
    """A number with its sign."""
    if value is None or not isfinite(value):
        return NONE
    text = f"{value:+.{decimals}f}"
    return text[1:] if float(text) == 0 else _minus(text)


def figure(value: float | int | None, figures: int = 3) -> str:
    """A number with so many figures, small ones in full while that can be read."""
    if value is None or not isfinite(value):
        return NONE
    if isinstance(value, int):
        return str(value)
    if value != 0 and abs(value) < 1e-4:
        return _minus(f"{value:.1e}")
    digits = f"{value:.{figures}g}"
    return _minus(f"{value:.0f}" if "e" in digits else digits)


def score_figure(name: str, value: float | int | None, figures: int = 3) -> str:
    """A figure of the score with its unit, which its name states; shares in per cent."""
    if value is None or not isfinite(value):
        return NONE
    if name in SHARES:
        return f"{figure(100.0 * value, figures)} %"
    unit = next((UNITS[part] for part in name.split("_") if part in UNITS), "")
    small = unit == "mm" and abs(value) < FINEST_MM  # nobody reads a wall to the micrometre
    return (f"below {FINEST_MM:g}" if small else figure(value, figures)) + ("" if unit in ("", "°") else " ") + unit


def _minus(text: str) -> str:
    return text.replace("-", "−")
