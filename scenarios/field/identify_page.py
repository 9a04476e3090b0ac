"""The page of an identification: what was found with its interval, what was not and why, spectra and the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from algorithms.identification.estimate import Estimate
from algorithms.identification.identify import Identified
from algorithms.identification.inertial import Imu, spectrum
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import SERIES, Picture, drawing, to_picture
from scenarios.report.numbers import figure

FOOTER = "Lengths in millimetres, angles in degrees. Intervals hold the value 95 times in 100. No truth was read."


def identify_page(log: Path, found: Identified, imu: Imu | None) -> str:
    """The whole page."""
    known = {name: one for name, one in found.quantities.items() if isinstance(one, Estimate)}
    unknown = [(name, one.reason) for name, one in found.quantities.items() if not isinstance(one, Estimate)]
    rows: list[tuple[str, ...]] = [("quantity", "estimate", "95 % from", "to", "n", "from what")]
    rows += [
        (name, *(figure(bound, _figures(one)) for bound in (one.value, one.low, one.high)), str(one.count), one.source)
        for name, one in known.items()
    ]
    sections = [Section("What was wrong with the log", found.said)] if found.said else []
    sections.append(Section("What the log tells", [], rows))
    if unknown:
        words = ["These stay at the scenario's default."]
        sections.append(Section("What it does not tell", words, [("quantity", "why not"), *unknown]))
    if imu is not None and imu.time_s.size > 100:
        sections.append(Section("The IMU", [], (), [_spectra(found, imu)]))
    if found.bands:
        sections.append(Section("Shaking in motion", [], _bands(found)))
    if found.way is not None:
        sections.append(Section("The way", [], (), [_way(found)]))
    verdict = f"{len(known)} quantities estimated, {len(unknown)} not."
    return calibration_page("Twin identified from a log", log.name, verdict, not found.said, sections, FOOTER)


def _figures(one: Estimate) -> int:
    """As many as tell the ends of the interval apart."""
    from math import ceil, log10

    width, size = one.high - one.low, max(abs(one.high), abs(one.low))
    return min(max(ceil(log10(size / width)) + 2, 3), 8) if width > 0 and size > 0 else 4


def _bands(found: Identified) -> list[tuple[str, ...]]:
    axes = "xyz"
    heads = ["band (Hz)", *(f"{axis} (m/s²)" for axis in axes), *(f"about {axis} (°/s)" for axis in axes)]
    rows = [tuple(heads)]
    for band in found.bands:
        cells = [
            f"{figure(one.value, 2)} ({figure(one.low, 2)} to {figure(one.high, 2)})"
            for one in (*band.force_m_s2, *(rate.scaled(float(np.degrees(1))) for rate in band.rate_rad_s))
        ]
        rows.append((f"{band.from_hz:g} to {band.to_hz:.3g}", *cells))
    return rows


def _spectra(found: Identified, imu: Imu) -> Picture:
    """Power of rates and forces over frequency, with the white noise that was estimated."""
    parts = (("gyroscope", imu.gyro_rad_s, "rad/s/√Hz"), ("accelerometer", imu.force_m_s2, "m/s²/√Hz"))
    with drawing(3.6) as drawn:
        for axes, (name, values, unit) in zip(drawn.subplots(1, 2), parts, strict=True):
            frequency, power = spectrum(imu, values)
            for axis, color, line in zip("xyz", SERIES, power.T, strict=False):
                # one-sided power is twice the density squared
                axes.loglog(frequency, np.sqrt(np.maximum(line, 1e-20) / 2), color=color, label=axis, linewidth=1)
            density = found.quantities.get(f"{name}_noise_density")
            if isinstance(density, Estimate):
                axes.axhline(density.value, color="#222222", linestyle="--", linewidth=1, label="white noise")
            axes.set(title=f"{name.capitalize()} in motion", xlabel="frequency (Hz)", ylabel=f"density ({unit})")
        axes.legend()
        return to_picture(drawn, "Noise density over frequency.", "Dashed: the white noise as estimated.")


def _way(found: Identified) -> Picture:
    """Offset, tilt and roll over time, and what each wheel slipped."""
    way = found.way
    assert way is not None  # noqa: S101  asked for only where there is one
    time, degrees = way.rows[:, 0], np.degrees(way.rows[:, 4:])
    groups = [
        ("Offset (mm)", way.rows[:, 2:4].T, ("x", "y")),
        ("Roll and tilt (°)", degrees.T, ("roll", "tilt about x", "tilt about y")),
        ("Slip so far (mm)", way.slip_mm.T, tuple(f"wheel {k + 1}" for k in range(way.slip_mm.shape[1]))),
    ]
    with drawing(7.0) as drawn:
        panels = drawn.subplots(3, 1, sharex=True)
        for axes, (label, lines, names) in zip(panels, groups, strict=True):
            for line, name, color in zip(lines, names, SERIES, strict=False):
                axes.plot(time, line, label=name, color=color, linewidth=1.2)
            axes.set_ylabel(label)
            axes.legend(loc="upper left", ncols=len(names))
        panels[0].set_title("The way across the pipe, and what the wheels slipped")
        axes.set_xlabel("time (s)")
        return to_picture(drawn, "Offset, roll, tilt and slip over time.", "As the replay goes it.")
