"""The frame of every page: one HTML file that opens offline, without a script or a second file."""

from __future__ import annotations

from html import escape
from pathlib import Path

STYLE = Path(__file__).parent / "page.css"


def page_html(title: str, head: str, body: str, footer: str, refresh: str = "") -> str:
    """A whole page; `title` is plain text, the rest is HTML, `refresh` a meta line for a page that renews itself."""
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
{refresh}<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>{escape(title)}</title>
<style>
{STYLE.read_text(encoding="utf-8")}</style>
</head>
<body>
<header>
{head}
</header>
<main>
{body}</main>
<footer>{footer}</footer>
</body>
</html>
"""
