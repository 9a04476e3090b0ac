"""The index of the paper: a row for each of its equations, figures and tables, with our value beside theirs."""

from __future__ import annotations

from pathlib import Path

from scenarios.paper.checked import DOES_NOT
from scenarios.paper.entries import ENTRIES, Entry
from scenarios.paper.made import NOT_MADE, fidelity
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.plain_rows import text_table
from scenarios.run_folder import whole_file

Row = dict[str, str]
COLUMNS = {
    "item": "item",
    "what": "what",
    "ours": "ours",
    "theirs": "the paper's",
    "verdict": "verdict",
    "command": "command",
    "where": "computed in",
}
BRIEF = {key: head for key, head in COLUMNS.items() if key != "where"}
FOOTER = (
    "Equations are computed while this page is made; figures and tables are read from what their commands wrote. What "
    "the paper prints: NDT & E International 139 (2023) 102936."
)


def rows_of(root: Path) -> list[Row]:
    """Every row; `root` holds the folders `paper` and `runs` that the commands write.

    Raises:
        BadInput: for a result file that cannot be read.
    """
    return [_row(entry, root) for entry in ENTRIES]


def _row(entry: Entry, root: Path) -> Row:
    found = [entry.check()] if entry.check else []
    if entry.reads:
        read = entry.reads(root)
        found += [] if found and read is NOT_MADE else [read]
    last = found[-1]  # what a command measured says more than the same equation by hand
    sees = fidelity(root, entry.command) if entry.reads and last is not NOT_MADE else ""
    return {
        "item": entry.item,
        "what": entry.what,
        "where": entry.where,
        "command": f"pipetwin {entry.command}",
        "ours": last.ours + (f" ({sees})" if sees else ""),
        "theirs": entry.theirs,
        "verdict": last.verdict,
    }


def words(rows: list[Row]) -> str:
    """The index for a terminal, and what is still to be made."""
    return "\n".join([text_table(rows, BRIEF), summary(rows)])


def summary(rows: list[Row]) -> str:
    """How many rows have a value, and how many do not hold."""
    unmade = sum(row["ours"] == NOT_MADE.ours for row in rows)
    failing = [row["item"] for row in rows if row["verdict"] == DOES_NOT]
    said = f"{len(rows) - unmade} of {len(rows)} made"
    return said + (f"; does not hold: {', '.join(failing)}" if failing else "; nothing made fails to hold")


def _cell(key: str, said: str) -> str:
    """A cell of the page: an item keeps to one line, a long name may break."""
    if key == "item":
        return said.replace(" ", "\u00a0")
    return said.replace(".", ".\u200b").replace(":", ":\u200b") if key == "where" else said


def write_page(rows: list[Row], page: Path) -> None:
    """The index as a page.

    Raises:
        BadInput: when the file cannot be written.
    """
    sections = []
    for title, prefix in (("Equations", "Eq."), ("Figures", "Fig."), ("Tables", "Table")):
        own = [row for row in rows if row["item"].startswith(prefix)]
        table = [list(COLUMNS.values()), *([_cell(key, row[key]) for key in COLUMNS] for row in own)]
        sections.append(Section(title, table=table))
    said = summary(rows)
    lead = "Every equation, figure and table, by the command that makes it: our value, the paper's, and the verdict."
    good = all(row["verdict"] != DOES_NOT for row in rows)
    html = calibration_page("The paper, made again", lead, f"{said}.", good, sections, FOOTER)
    with whole_file(page) as work:
        work.write_text(html, encoding="utf-8")
