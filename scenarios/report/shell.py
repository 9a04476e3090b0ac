"""The frame of every page: one HTML file that opens offline, without a second file, and with no script but its own."""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
from html import escape
from pathlib import Path

STYLE = Path(__file__).parent / "page.css"


def page_html(title: str, head: str, body: str, footer: str, refresh: str = "", script: str = "") -> str:
    """A whole page; `title` is plain text, the rest is HTML, `refresh` a meta line for a page that renews itself.

    `script` is the only one that the page lets run, by its digest.
    """
    allowed, run = "", ""
    if script:
        digest = b64encode(sha256(script.encode()).digest()).decode()
        allowed, run = f"; script-src 'sha256-{digest}'", f"<script>{script}</script>\n"
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
{refresh}<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'{allowed}">
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
{run}</body>
</html>
"""
