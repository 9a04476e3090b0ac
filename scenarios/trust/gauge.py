"""A gauge study from a CSV: repeatability and reproducibility, in words and as a page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.trust.gauge import GaugeStudy, RangeStudy, gauge_study, range_study
from scenarios.document import BadInput
from scenarios.provenance import write_versions
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import SERIES, Picture, drawing, to_picture
from scenarios.report.plain_rows import text_table
from scenarios.run_folder import run_folder
from scenarios.trust.columns import Table, names, numbers, raise_faults, read_table

MARKERS = "osD^v<>P"
MEANING = {
    "EV": "repeatability: one operator, one part",
    "AV": "reproducibility: between operators",
    "INT": "operator by part",
    "GRR": "gauge: all of these",
    "PV": "part to part",
    "TV": "total",
}
GOOD_PCT, FAIR_PCT, FEWEST_CATEGORIES = 10.0, 30.0, 5  # of the study variation (AIAG MSA)
FOOTER = (
    "Values in the table's own unit. Crossed analysis of variance with random parts and operators (AIAG MSA, 4th ed.)."
)
COLUMNS = {"name": "", "meaning": "what", "sd": "sd (anova)", "contribution_pct": "% of variance"}
COLUMNS |= {"study_pct": "% of study", "range_sd": "sd (ranges)"}
TABLE = {
    "source": "source",
    "degrees_of_freedom": "dof",
    "sum_of_squares": "SS",
    "mean_square": "MS",
    "f": "F",
    "p": "p",
}
Row = dict[str, Any]


class Gauge(NamedTuple):
    """The values and what they say by variance and by ranges."""

    parts: list[str]
    operators: list[str]
    values: np.ndarray
    study: GaugeStudy
    ranges: RangeStudy


def gauge_of(file: Path, part: str, operator: str, value: str) -> Gauge:
    """Read and analyse.

    Raises:
        BadInput: for a table that cannot be used, or cells of unequal number of trials, each named.
    """
    table = read_table(file)
    faults: list[str] = []
    parts, operators = names(table, part, faults), names(table, operator, faults)
    values = numbers(table, value, faults)
    raise_faults(faults)
    part_names, operator_names = list(dict.fromkeys(parts)), list(dict.fromkeys(operators))
    cells: dict[tuple[str, str], list[float]] = {(p, o): [] for p in part_names for o in operator_names}
    for p, o, v in zip(parts, operators, values, strict=True):
        cells[p, o].append(float(v))
    _balanced(table, cells)
    block = np.array([[cells[p, o] for o in operator_names] for p in part_names])
    try:
        return Gauge(part_names, operator_names, block, gauge_study(block), range_study(block))
    except ValueError as error:
        raise BadInput([f"{file}: {error}"]) from error


def _balanced(table: Table, cells: dict[tuple[str, str], list[float]]) -> None:
    """Raise unless every operator measured every part equally often."""
    counts = [len(values) for values in cells.values()]
    usual = max(set(counts), key=counts.count)
    raise_faults(
        [
            f"{table.file}: part {p}, operator {o}: got {len(values)} trials, most others {usual}; each needs as many "
            "(leave the part out, or measure again)"
            for (p, o), values in cells.items()
            if len(values) != usual
        ]
    )


def run_gauge(file: Path, part: str, operator: str, value: str, out: Path) -> Gauge:
    """Analyse, and write the page and the figures into a folder.

    Raises:
        BadInput: for a table that cannot be used, or a folder that cannot be written.
    """
    gauge = gauge_of(file, part, operator, value)
    with run_folder(out) as folder:
        (folder / "gauge.json").write_text(json.dumps(figures(gauge), indent=1, allow_nan=False) + "\n")
        (folder / "report.html").write_text(page(file, gauge), encoding="utf-8")
        write_versions(folder)
    return gauge


def figures(gauge: Gauge) -> Row:
    """All figures as JSON gives them."""
    study, ranges = gauge.study, gauge.ranges
    return {
        "parts": len(gauge.parts),
        "operators": len(gauge.operators),
        "trials": int(gauge.values.shape[2]),
        "table": [line._asdict() for line in study.table],
        "interaction_pooled": study.pooled,
        "variation": [part._asdict() for part in study.variation],
        "repeatability_95": list(study.repeatability_interval),
        "ndc": study.ndc,
        "taken_as_zero": list(study.negative),
        "ranges": {**ranges._asdict(), "variation": [part._asdict() for part in ranges.variation]},
    }


def variation_rows(gauge: Gauge) -> list[Row]:
    """A row for each part of the variation, by both ways."""
    by_range = {part.name: part.standard_deviation for part in gauge.ranges.variation}
    return [
        {
            "name": part.name,
            "meaning": MEANING[part.name],
            "sd": part.standard_deviation,
            "contribution_pct": part.contribution_pct,
            "study_pct": part.study_variation_pct,
            "range_sd": None if part.name == "INT" else by_range[part.name],
        }
        for part in gauge.study.variation
    ]


def verdict(gauge: Gauge) -> str:
    """The manual's verdict in one line."""
    share = next(part.study_variation_pct for part in gauge.study.variation if part.name == "GRR")
    said = "good" if share <= GOOD_PCT else "fair, for some uses" if share <= FAIR_PCT else "not acceptable"
    few = "" if gauge.study.ndc >= FEWEST_CATEGORIES else f"; fewer than {FEWEST_CATEGORIES} categories"
    tells = f"tells {gauge.study.ndc} categories apart"
    return f"The gauge takes {share:.2f} % of the study's spread and {tells}: {said}{few}."


def notes(gauge: Gauge) -> list[str]:
    """How the table was read, and what is weak."""
    study = gauge.study
    low, high = study.repeatability_interval
    p = study.table[2].p
    said = [
        f"repeatability {study.sd('EV'):.4g}, 95 % interval {low:.4g} to {high:.4g}",
        f"interaction p {p:.4f}: " + ("taken as repeatability (above 0.25)" if study.pooled else "kept apart"),
    ]
    said += [f"the variance of {name} came out below 0 and is taken as 0" for name in study.negative]
    if len(gauge.operators) < 3:
        said.append(f"{len(gauge.operators)} operators say little about reproducibility")
    return said


def words(gauge: Gauge) -> str:
    """All of it for a terminal."""
    lines = [line._asdict() for line in gauge.study.table]
    blocks = [verdict(gauge), text_table(variation_rows(gauge), COLUMNS), text_table(lines, TABLE)]
    return "\n\n".join([*blocks, "\n".join(notes(gauge))])


def page(file: Path, gauge: Gauge) -> str:
    """The page: values by part and operator, the parts of the variation, the table of variance."""
    rows = [[*COLUMNS.values()], *([_cell(row[key]) for key in COLUMNS] for row in variation_rows(gauge))]
    lines = [[*TABLE.values()], *([_cell(line._asdict()[key]) for key in TABLE] for line in gauge.study.table)]
    shape = " x ".join(
        f"{n} {name}" for n, name in zip(gauge.values.shape, ("parts", "operators", "trials"), strict=True)
    )
    grr = next(part.study_variation_pct for part in gauge.study.variation if part.name == "GRR")
    sections = [
        Section("Values", pictures=[_picture(gauge)]),
        Section("Variation", notes(gauge), rows),
        Section("Analysis of variance", table=lines),
    ]
    return calibration_page("Gauge study", f"{file.name}: {shape}", verdict(gauge), grr <= FAIR_PCT, sections, FOOTER)


def _cell(value: Any) -> str:
    return "" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _picture(gauge: Gauge) -> Picture:
    """Every trial, part by part, about the part's mean."""
    with drawing(4.0) as figure:
        axes = figure.subplots()
        n = len(gauge.operators)
        for k, name in enumerate(gauge.operators):
            own = gauge.values[:, k] - gauge.values.mean((1, 2))[:, None]
            place = np.arange(len(gauge.parts))[:, None] + (k - (n - 1) / 2) * 0.6 / n + np.zeros_like(own)
            axes.plot(
                place.ravel(),
                own.ravel(),
                MARKERS[k % len(MARKERS)],
                color=SERIES[k % len(SERIES)],
                markersize=4,
                label=name,
            )
        axes.axhline(0, color="#777777", linewidth=0.8)
        axes.set_xticks(np.arange(len(gauge.parts)), gauge.parts)
        axes.set_xlabel("part")
        axes.set_ylabel("value less the part's mean")
        axes.set_title("Trials about each part's mean, by operator")
        axes.legend(ncols=min(n, 8))
        return to_picture(
            figure,
            "Each trial less its part's mean, by part and operator",
            "The scatter of one mark in one part is repeatability; marks apart in every part are reproducibility.",
        )
