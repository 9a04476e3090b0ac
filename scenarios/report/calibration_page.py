"""The page of a calibration or of a decoded picture: one HTML file that opens offline, in the run report's style."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from scenarios.report.canvas import Picture
from scenarios.report.shell import page_html


class Section(NamedTuple):
    """One part of the page: heading, sentences, a table (its heads first), pictures."""

    title: str
    sentences: Sequence[str] = ()
    table: Sequence[Sequence[str]] = ()
    pictures: Sequence[Picture] = ()


FOOTER = "Lengths in millimetres, angles in degrees, pixel centres at integers."


def calibration_page(
    title: str, lead: str, verdict: str, good: bool, sections: Sequence[Section], footer: str = FOOTER
) -> str:
    """The whole page."""
    body = "".join(_section(section) for section in sections)
    return page_html(
        title,
        f"""<h1>{escape(title)}</h1>
<p class="lead">{escape(lead)}</p>
<p class="verdict {"clean" if good else "faulty"}">{escape(verdict)}</p>""",
        body,
        escape(footer),
    )


def _section(section: Section) -> str:
    words = "".join(f"<p>{escape(sentence)}</p>" for sentence in section.sentences)
    pictures = "".join(_figure(picture) for picture in section.pictures)
    return f"<section><h2>{escape(section.title)}</h2>{words}{table_html(section.table)}{pictures}</section>\n"


def table_html(rows: Sequence[Sequence[str]]) -> str:
    """Rows of plain text, the heads first, as a table that scrolls by itself."""
    if not rows:
        return ""
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in rows[0])
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows[1:])
    return f'<div class="scroll" tabindex="0"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _figure(picture: Picture) -> str:
    size = f'width="{picture.width_px}" height="{picture.height_px}"'
    image = f'<img src="{picture.source}" {size} alt="{escape(picture.alt)}">'
    return f"<figure>{image}<figcaption>{escape(picture.caption)}</figcaption></figure>"
