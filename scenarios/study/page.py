"""The study page: one HTML file that opens offline; failures first, every figure with its n."""

from __future__ import annotations

from html import escape
from itertools import islice
from math import isfinite
from pathlib import Path

from scenarios.extrapolated import reasons_of
from scenarios.report.canvas import Picture
from scenarios.report.shell import page_html
from scenarios.run_folder import whole_file
from scenarios.study.figures import over_factor, unity
from scenarios.study.gather import Gathered, Mean, gather, levels, mean_of, paired
from scenarios.study.ledger import DONE, STATES, Ledger, Row
from scenarios.study.plan import Recipe

PAGE_FILE = "study.html"
MOST_FAILURES = 200
REFRESH_S = 15
LONGEST_VALUE = 40
MOST_LOOKED_AT = 200


def write_page(ledger: Ledger, file: Path, running: bool = False) -> None:
    """Write the page; while the study runs only how far it is and what has failed, which takes no time."""
    counts = ledger.counts()
    sections = {"Failures": failures(ledger, counts["failed"]), "Progress": progress(ledger, counts, running)}
    if not running and counts["done"]:
        sections |= _findings(ledger) | beyond_validated(ledger)
    with whole_file(file) as work:
        work.write_text(_page(ledger, counts, sections, running), encoding="utf-8")


def _page(ledger: Ledger, counts: dict[str, int], sections: dict[str, str], running: bool) -> str:
    total = sum(counts.values())
    state = "Running: " if running else "" if counts["done"] + counts["failed"] == total else "Stopped: "
    verdict = f"{state}{counts['done']} of {total} runs done, {counts['failed']} failed."
    clean = not counts["failed"] and counts["done"] == total
    refresh_s = REFRESH_S if running else None
    title, lead = f"Study: {ledger.about('name')}", str(ledger.about("why") or "")
    return html_page(title, lead, verdict, clean, sections, refresh_s)


def html_page(
    title: str, lead: str, verdict: str, clean: bool, sections: dict[str, str], refresh_s: int | None = None
) -> str:
    """A page in the report's style; the sections are HTML, all else is text."""
    refresh = f'<meta http-equiv="refresh" content="{refresh_s}">\n' if refresh_s else ""
    body = "".join(f"<section><h2>{escape(name)}</h2>{inside}</section>\n" for name, inside in sections.items())
    return page_html(
        title,
        f"""<h1>{escape(title)}</h1>
<p class="lead">{escape(lead)}</p>
<p class="verdict {"clean" if clean else "faulty"}">{escape(verdict)}</p>""",
        body,
        """\
Simulated scans: the measurement never saw the truth it is compared with. Intervals are 95 %, Student's, as if
all runs were independent. Methods measure the same recordings, so that differences between them are paired; runs of one
seed share their draws over the factors' values too.""",
        refresh,
    )


# ---- failures, progress, and how far it is to be believed


def beyond_validated(ledger: Ledger) -> dict[str, str]:
    """Why the study's runs go beyond what the testbench was held against: no section where they do not."""
    known = ledger.about("identity")
    recipe = Recipe(
        known["base"],
        tuple(known["paths"]),
        known["methods"],
        tuple(known["record"]),
        known["code"],
        known.get("scenes", {}),
    )
    done = (row for row in ledger.rows(by_key=False) if row.state == STATES[DONE])
    reasons = reasons_of(recipe.scenario(row.values, row.method, row.seed) for row in islice(done, MOST_LOOKED_AT))
    if not reasons:
        return {}
    listed = "".join(f"<li>{escape(reason)}</li>" for reason in reasons)
    return {"Extrapolated: beyond what the testbench was held against": f"<ul>{listed}</ul>"}


def failures(ledger: Ledger, count: int) -> str:
    """Every failed run by its key, with what it was and why it failed."""
    if not count:
        return "<p>None.</p>"
    paths = list(ledger.about("identity")["paths"])
    head = cells("th", ["key", "method", "seed", *paths, "cause", "error"])
    rows = "".join(cells("td", _failure(row)) for row in ledger.failures(MOST_FAILURES))
    more = f"<p>{count - MOST_FAILURES} more are in the ledger.</p>" if count > MOST_FAILURES else ""
    return f'<div class="scroll" tabindex="0"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>{more}'


def _failure(row: Row) -> list[str]:
    values = [str(value)[:LONGEST_VALUE] for value in row.values]
    return [row.key[:12], row.method, str(row.seed), *values, row.cause or "", row.error or ""]


def progress(ledger: Ledger, counts: dict[str, int], running: bool) -> str:
    """Runs by state, rate, and time left."""
    total, finished = sum(counts.values()), counts["done"] + counts["failed"]
    facts = {"runs": f"{total}", **{name: f"{n}" for name, n in counts.items()}}
    if repeats := ledger.about("repeats"):
        facts["repeats of other runs"] = f"{repeats}, made once"
    pace = ledger.about("pace")
    if pace and pace["done"] and pace["at_s"] > pace["since_s"]:
        rate = pace["done"] / (pace["at_s"] - pace["since_s"])
        facts["rate"] = f"{rate:.3g} runs/s"
        if finished < total:
            facts["time left"] = f"{(total - finished) / rate / 60:.3g} min"
    if not running:  # it takes a look at every row
        facts["worker time"] = f"{ledger.seconds():.3g} s"
    return "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in facts.items()) + "</dl>"


# ---- findings


def _findings(ledger: Ledger) -> dict[str, str]:
    found = gather(ledger)
    sections = {"Methods": methods_table(found)}
    if len(found.methods) > 1:
        sections["Methods, paired"] = paired_table(found)
    for path in found.paths:
        sections[f"Over {path}"] = figure_html(over_factor(found, path)) + factor_table(found, path)
    if len(found.defects):
        sections["Measured over true"] = figure_html(unity(found))
    return sections


def methods_table(found: Gathered) -> str:
    """Every recorded figure by method: mean, interval, n."""
    every = [found.method == k for k in range(len(found.methods))]
    head = cells("th", ["figure", *found.methods])
    rows = "".join(
        cells("td", [name, *(mean_text(mean_of(found.column(name)[own])) for own in every)]) for name in found.names
    )
    return table(head, rows, "Mean ± half the width of its 95 % interval, and of how many runs.")


def paired_table(found: Gathered) -> str:
    """Differences of each further method from the first, scan by scan."""
    others = range(1, len(found.methods))
    head = cells("th", ["figure", *(f"{found.methods[k]} − {found.methods[0]}" for k in others)])
    rows = "".join(cells("td", [name, *(mean_text(paired(found, name, k)) for k in others)]) for name in found.names)
    return table(head, rows, "Mean difference over the scans that both methods measured, n scans.")


def factor_table(found: Gathered, path: str) -> str:
    """The leading figures by the factor's level and by method."""
    head = cells("th", [path, "method", *found.leading])
    rows = ""
    for level in levels(found, path):
        for k, method in enumerate(found.methods):
            own = level.runs & (found.method == k)
            rows += cells(
                "td", [level.name, method, *(mean_text(mean_of(found.column(n)[own])) for n in found.leading)]
            )
    return table(head, rows, "Mean ± half the width of its 95 % interval, and of how many runs.")


def mean_text(value: Mean) -> str:
    """A mean with its interval and its n."""
    if not isfinite(value.mean):
        return f"n/a (n = {value.n})"
    half = "" if value.half is None else f" ± {value.half:.2g}"
    return f"{value.mean:.4g}{half} (n = {value.n})".replace("-", "−")


def table(head: str, rows: str, caption: str) -> str:
    """A table with its caption."""
    return (
        f'<div class="scroll" tabindex="0"><table><caption>{escape(caption)}</caption><thead>{head}</thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def cells(cell: str, texts: list[str]) -> str:
    """One row of a table, its texts escaped."""
    scope = ' scope="col"' if cell == "th" else ""
    return "<tr>" + "".join(f"<{cell}{scope}>{escape(text)}</{cell}>" for text in texts) + "</tr>"


def figure_html(picture: Picture) -> str:
    """A picture with its caption."""
    size = f'width="{picture.width_px}" height="{picture.height_px}"'
    image = f'<img src="{picture.source}" {size} alt="{escape(picture.alt)}">'
    return (
        f'<figure><div class="scroll" tabindex="0">{image}</div><figcaption>{escape(picture.caption)}</figcaption>'
        "</figure>"
    )
