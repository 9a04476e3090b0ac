"""Fig. 16 of the paper: uncertainty over the number of scans, from all subsets of Table 2's six."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

from algorithms.trust.budget import coverage_factor
from scenarios.paper.printed import DIMENSIONS, TABLE_2_MM, TABLE_3_K, TABLE_3_STANDARD_MM
from scenarios.provenance import write_versions
from scenarios.report.canvas import SERIES, drawing, to_picture
from scenarios.report.plain_rows import text_table, write_rows
from scenarios.run_folder import run_folder

Row = dict[str, Any]
MARKERS = ("o", "s", "D")
COLUMNS = {
    "dimension": "mm",
    "scans": "scans",
    "subsets": "subsets",
    "deviation_mm": "mean S",
    "unbiased_mm": "mean S / c4",
    "standard_mm": "mean S / sqrt(m)",
    "expanded_k196_mm": "times 1.96",
    "expanded_t_mm": "times t",
}


def mean_subset_deviation(values: Float[np.ndarray, "n"], size: int) -> float:
    """The mean standard deviation of all subsets of a size, as the paper's text below Eq. 31 describes."""
    return float(np.mean([np.std(subset, ddof=1) for subset in combinations(values, size)]))


def c4(n: int) -> float:
    """The mean standard deviation of n normal values over the true one: small samples seem to scatter less."""
    return float(np.sqrt(2 / (n - 1)) * np.exp(gammaln(n / 2) - gammaln((n - 1) / 2)))


def fig16_rows() -> list[Row]:
    """A row for each dimension and number of scans; one scan has no standard deviation, and so no row."""
    rows = []
    for name in DIMENSIONS:
        values = TABLE_2_MM[name]
        for m in range(2, values.size + 1):
            deviation = mean_subset_deviation(values, m)
            standard = deviation / float(np.sqrt(m))
            rows.append(
                {
                    "dimension": name,
                    "scans": m,
                    "subsets": len(list(combinations(range(values.size), m))),
                    "deviation_mm": deviation,
                    "unbiased_mm": deviation / c4(m),
                    "standard_mm": standard,
                    "expanded_k196_mm": TABLE_3_K * standard,
                    "expanded_t_mm": coverage_factor(0.95, m - 1) * standard,
                }
            )
    return rows


def words(rows: list[Row]) -> str:
    """The table for a terminal, and what it is."""
    lines = [
        text_table(rows, COLUMNS, "Fig. 16: uncertainty over the number of scans, from all subsets of Table 2's six"),
        "That the standard uncertainty falls is the divisor sqrt(m), not a finding: mean S / c4, the scatter itself,",
        "stays as it is. The subsets share scans, so their agreement says nothing new; six scans remain six scans.",
    ]
    return "\n".join(lines)


def run_fig16(out: Path) -> list[Row]:
    """Make the rows, and write them and the picture into a folder.

    Raises:
        BadInput: when the folder cannot be written.
    """
    rows = fig16_rows()
    with run_folder(out) as folder:
        write_rows(rows, folder / "fig16")
        (folder / "fig16.png").write_bytes(picture(rows))
        write_versions(folder)
    return rows


def picture(rows: list[Row]) -> bytes:
    """Standard uncertainty and its expansions over the number of scans, as a PNG."""
    from matplotlib.ticker import NullFormatter, ScalarFormatter

    with drawing(4.2, 12.0) as figure:
        left, right = figure.subplots(1, 2)
        for name, color, marker in zip(DIMENSIONS, SERIES, MARKERS, strict=False):
            own = [row for row in rows if row["dimension"] == name]
            scans = [row["scans"] for row in own]
            left.plot(
                scans, [row["standard_mm"] for row in own], marker, color=color, label=f"{name}: mean S / sqrt(m)"
            )
            m = np.linspace(2, 6, 100)
            left.plot(m, own[-1]["deviation_mm"] / np.sqrt(m), color=color, linewidth=0.9)
            left.plot([6.3], [TABLE_3_STANDARD_MM[name]], "x", color=color, markersize=9, markeredgewidth=2)
            right.plot(
                scans, [row["expanded_t_mm"] for row in own], marker + "-", color=color, label=f"{name}: times t"
            )
            right.plot(scans, [row["expanded_k196_mm"] for row in own], marker + ":", color=color, mfc="white")
        left.plot([], [], "x", color="#222222", markersize=9, markeredgewidth=2, label="Table 3 as printed (six scans)")
        left.plot([], [], color="#222222", linewidth=0.9, label="S of all six / sqrt(m)")
        right.plot([], [], "o:", color="#222222", mfc="white", label="times 1.96")
        left.set_title("Standard uncertainty falls as 1 / sqrt(m)")
        left.set_ylabel("standard uncertainty (mm)")
        right.set_title("Few scans ask for Student's t, not 1.96")
        right.set_ylabel("expanded uncertainty, 95 % (mm, log axis)")
        right.set_yscale("log")
        for axes in (left, right):
            axes.set_xlabel("number of scans m")
            axes.set_xticks(range(2, 7))
            axes.legend()
        left.set_ylim(0)
        left.set_xlim(1.8, 6.6)
        right.yaxis.set_major_formatter(ScalarFormatter())
        right.set_yticks([1, 2, 5, 10, 20, 50])
        right.yaxis.set_minor_formatter(NullFormatter())
        return to_picture(figure, "", "").file
