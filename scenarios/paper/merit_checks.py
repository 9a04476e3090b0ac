"""Eqs 28 to 32 on the numbers that the paper prints, and what its drawings say of pipe and robot."""

from __future__ import annotations

import numpy as np

from scenarios.equations import depth_quality_pct, err_pct, error_pct, radius_closeness_pct
from scenarios.paper.checked import Found, difference, verdict
from scenarios.paper.printed import (
    DIMENSIONS,
    TABLE_2_ERR_PCT,
    TABLE_2_ERROR_PCT,
    TABLE_2_MM,
    TABLE_3_STANDARD_MM,
    TABLE_4_DEPTH_MM,
    TABLE_4_ESTIMATE_MM,
    TABLE_4_QUALITY_PCT,
    TRUE_SIZE_MM,
)

PRINTED_PCT = 0.06  # what sizes printed to 0.1 mm leave open
MOTOR_PULSES, EDGES, GEAR = 7, 4, 603


def eq28() -> Found:
    """Closeness of two radii, by hand."""
    return difference(abs(radius_closeness_pct(np.array([76.0, 77.0]), 76.0) - 100 * 0.5 / 76.0), "%", 1e-12)


def _scans() -> tuple[np.ndarray, np.ndarray]:
    """Table 2's scans, a row a scan, and the true size."""
    return np.stack([TABLE_2_MM[d] for d in DIMENSIONS], axis=1), np.array([TRUE_SIZE_MM[d] for d in DIMENSIONS])


def eq29() -> Found:
    """Err on the paper's own sizes."""
    sizes, true = _scans()
    off = np.abs(np.array([err_pct(*size[:2], *true[:2]) for size in sizes]) - TABLE_2_ERR_PCT).max()
    return Found(f"its Table 2 again, to {off:.2f} points", verdict(off <= PRINTED_PCT))


def eq30() -> Found:
    """Error on the paper's own sizes; it divides by three."""
    sizes, true = _scans()
    off = np.abs(np.array([error_pct(size, true) for size in sizes]) - TABLE_2_ERROR_PCT).max()
    return Found(f"its Table 2 again, to {off:.2f} points", verdict(off <= PRINTED_PCT))


def eq31() -> Found:
    """The standard uncertainty of the paper's own sizes."""
    from scenarios.paper.table3 import table3_rows

    rows = table3_rows()
    said = " / ".join(f"{row['standard_mm']:.2f}" for row in rows)
    off = max(abs(row["standard_mm"] - TABLE_3_STANDARD_MM[row["dimension"]]) for row in rows)
    return Found(f"{said} mm on its Table 2", "Table 3 does not follow" if off > 0.05 else verdict(True))


def table3() -> Found:
    """Expanded by Student's t, as six scans ask."""
    from scenarios.paper.table3 import table3_rows

    rows = table3_rows()
    said = " / ".join(f"{row['expanded_t_mm']:.2f}" for row in rows)
    follows = all(row["verdict"] == "follows" for row in rows)
    return Found(f"{said} mm (2.571 u)", "follows" if follows else "does not follow from Table 2")


def eq32() -> Found:
    """Quality of the printed means: an upper bound of the mean quality of what they are means of."""
    pairs = zip(TABLE_4_ESTIMATE_MM, TABLE_4_DEPTH_MM, strict=True)
    most = [depth_quality_pct(np.array([mean]), np.array([true])) for mean, true in pairs]
    held = all(printed <= bound + 0.5 for printed, bound in zip(TABLE_4_QUALITY_PCT, most, strict=True))
    said = " / ".join(f"{value:.1f}" for value in most)
    return Found(f"at most {said} % of its means", "agrees with Table 4" if held else verdict(False))


def fig8() -> Found:
    """Counts of an encoder wheel's turn, and the robot's wheels."""
    from sensor_model.rig import preset_rig

    wheels = preset_rig().wheels
    said = f"{wheels.counts_per_turn} counts a turn, {len(wheels.diameters_mm)} encoder wheels"
    return Found(said, verdict(wheels.counts_per_turn == MOTOR_PULSES * EDGES * GEAR))


def fig9() -> Found:
    """The pipe and its two defects."""
    from scenarios.load import load_scenario

    pipe = load_scenario("paper-gantry").pipe
    sizes = {tuple(round(float(v), 6) for v in f.size(pipe.bore_radius_mm)) for f in pipe.features}
    same = sizes == {tuple(TRUE_SIZE_MM[d] for d in DIMENSIONS)} and len(pipe.features) == 2
    said = "; ".join(" x ".join(f"{v:g}" for v in size) for size in sorted(sizes))
    return Found(f"{len(pipe.features)} defects of {said} mm, bore {2 * pipe.bore_radius_mm:g} mm", verdict(same))


def fig16() -> Found:
    """The standard uncertainty over scans, and the scatter itself."""
    from scenarios.paper.fig16 import fig16_rows

    rows = [row for row in fig16_rows() if row["dimension"] == "length"]
    first, last = rows[0], rows[-1]
    said = (
        f"length {first['standard_mm']:.2f} to {last['standard_mm']:.2f} mm; scatter S / c4 {first['unbiased_mm']:.2f}"
    )
    return Found(f"{said} to {last['unbiased_mm']:.2f} mm", "the fall is the divisor sqrt(m)")
