"""Table 3 of the paper from its own Table 2: Eq. 31 as it stands, and what six scans do say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from algorithms.trust.budget import coverage_factor, from_readings
from scenarios.equations import err_pct, error_pct
from scenarios.paper.printed import (
    DIMENSIONS,
    TABLE_2_ERR_PCT,
    TABLE_2_ERROR_PCT,
    TABLE_2_MM,
    TABLE_3_EXPANDED_MM,
    TABLE_3_K,
    TABLE_3_MEAN_MM,
    TABLE_3_STANDARD_MM,
    TRUE_SIZE_MM,
)
from scenarios.provenance import write_versions
from scenarios.report.plain_rows import text_table, write_rows
from scenarios.run_folder import run_folder

Row = dict[str, Any]
ROUNDING_MM = 0.05  # what Table 2's one decimal leaves open of a mean
COLUMNS = {
    "dimension": "mm",
    "true_mm": "true",
    "mean_mm": "mean",
    "paper_mean_mm": "paper's",
    "deviation_mm": "S",
    "standard_mm": "u, Eq. 31",
    "paper_standard_mm": "paper's",
    "expanded_k196_mm": "1.96 u",
    "paper_expanded_mm": "paper's",
    "expanded_t_mm": "2.571 u",
    "one_scan_mm": "one scan",
    "bias_mm": "bias",
    "verdict": "Table 3",
}


def standard_uncertainty_mm(values_mm: Float[np.ndarray, "n"]) -> float:
    """Eq. 31's standard uncertainty of the mean of repeated scans."""
    n = values_mm.size
    return float(np.sqrt(np.sum((values_mm - values_mm.mean()) ** 2) / (n * (n - 1))))  # Eq. 31


def table3_rows() -> list[Row]:
    """A row a dimension: what Eq. 31 gives on Table 2, beside what Table 3 prints."""
    rows = []
    for name in DIMENSIONS:
        values = TABLE_2_MM[name]
        source = from_readings(name, values)
        standard, t = standard_uncertainty_mm(values), coverage_factor(0.95, source.degrees_of_freedom)
        deviation = float(values.std(ddof=1))
        follows = abs(standard - TABLE_3_STANDARD_MM[name]) <= ROUNDING_MM
        bias, half = float(values.mean() - TRUE_SIZE_MM[name]), t * standard
        rows.append(
            {
                "dimension": name,
                "true_mm": TRUE_SIZE_MM[name],
                "mean_mm": float(values.mean()),
                "paper_mean_mm": TABLE_3_MEAN_MM[name],
                "deviation_mm": deviation,
                "standard_mm": standard,
                "paper_standard_mm": TABLE_3_STANDARD_MM[name],
                "expanded_k196_mm": TABLE_3_K * standard,
                "paper_expanded_mm": TABLE_3_EXPANDED_MM[name],
                "expanded_t_mm": half,
                "one_scan_mm": t * deviation * float(np.sqrt(1 + 1 / values.size)),
                "bias_mm": bias,
                "bias_low_mm": bias - half,
                "bias_high_mm": bias + half,
                "verdict": "follows" if follows else "does not follow",
            }
        )
    return rows


def words(rows: list[Row]) -> str:
    """The table for a terminal, with what its columns are."""
    lines = [
        "Table 3 from Table 2's six scans (Eq. 31: u = S / sqrt(6))",
        text_table(rows, COLUMNS),
        "2.571 u: Student's t for five degrees of freedom, as six scans ask; k = 1.96 would need the true spread.",
        "one scan: the half width that holds the next single scan with 95 %; u is of the mean of six.",
        "u says how well the six agree. It does not hold the bias, which needs the true size: "
        + ", ".join(f"{r['dimension']} {r['bias_low_mm']:+.1f} to {r['bias_high_mm']:+.1f} mm" for r in rows)
        + " (95 %).",
        f"Table 2 itself holds: Eqs 29 and 30 give its Err to {_off(0):.2f} and its Error to {_off(1):.2f} points.",
    ]
    return "\n".join(lines)


def _off(which: int) -> float:
    """How far Eq. 29 (0) or Eq. 30 (1) on Table 2's sizes comes from the printed figures at worst, in points."""
    true = np.array([TRUE_SIZE_MM[name] for name in DIMENSIONS])
    scans = np.stack([TABLE_2_MM[name] for name in DIMENSIONS], axis=1)
    if which == 0:
        found, printed = [err_pct(*scan[:2], *true[:2]) for scan in scans], TABLE_2_ERR_PCT
    else:
        found, printed = [error_pct(scan, true) for scan in scans], TABLE_2_ERROR_PCT
    return float(np.max(np.abs(np.array(found) - printed)))


def run_table3(out: Path) -> list[Row]:
    """Make the rows and write them into a folder.

    Raises:
        BadInput: when the folder cannot be written.
    """
    rows = table3_rows()
    with run_folder(out) as folder:
        write_rows(rows, folder / "table3")
        write_versions(folder)
    return rows
