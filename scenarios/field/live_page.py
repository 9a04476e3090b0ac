"""The page of a live log: made anew every few seconds, served to this machine alone."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import NamedTuple

import numpy as np

from algorithms.large_arrays import lines
from algorithms.types import Reconstruction
from scenarios.report.canvas import Picture
from scenarios.report.numbers import fixed
from scenarios.report.page import figure_html
from scenarios.report.shell import page_html
from sensor_model.geometry import clock_position

HOST = "127.0.0.1"
REFRESH_S = 2
MOST_DEFECTS = 200
MAP_PX = 900, 360
UNSEEN_GREY = 226
LEAST_RANGE_MM = 0.5


class Live(NamedTuple):
    """What is known at one moment; `found` is None while nothing is, and `why` says the reason."""

    frames: int
    distance_mm: float
    decode_yield: float
    reason: str
    late_share: float
    wait_s: float
    unreadable: int
    found: Reconstruction | None
    why: str


@dataclass
class Server:
    """One page at one address of this machine."""

    http: ThreadingHTTPServer
    page: bytes = b""

    @property
    def address(self) -> str:
        """Where a browser on this machine finds it."""
        return f"http://{HOST}:{self.http.server_address[1]}/"

    def show(self, page: str) -> None:
        """Put a page in place of the last."""
        self.page = page.encode()

    def close(self) -> None:
        """Stop serving."""
        self.http.shutdown()
        self.http.server_close()


def serve(port: int) -> Server:
    """Serve a page on the loopback alone; port 0 takes a free one.

    Raises:
        OSError: when the port is taken.
    """
    server = Server(ThreadingHTTPServer((HOST, port), BaseHTTPRequestHandler))
    server.show(page_html("live", "<h1>Live</h1><p>No frame yet.</p>", "", "", _refresh()))
    own = {f"{name}:{server.http.server_address[1]}" for name in (HOST, "localhost")}

    class Handler(BaseHTTPRequestHandler):
        """Gives the page, and nothing else."""

        timeout = 5

        def do_GET(self) -> None:
            """Answer; another host's name means that another site asks through the browser."""
            found = self.path == "/" and self.headers.get("Host") in own
            content = server.page if found else b"nothing is here\n"
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8" if found else "text/plain")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *_: object) -> None:
            """Say nothing."""

    server.http.RequestHandlerClass = Handler
    threading.Thread(target=server.http.serve_forever, daemon=True).start()
    return server


def _refresh() -> str:
    return f'<meta http-equiv="refresh" content="{REFRESH_S}">\n'


def live_page(live: Live) -> str:
    """The page of this moment."""
    timely = f"{100 * live.late_share:.1f} % of the frames late by over two periods"
    pairs = [
        ("Frames", f"{live.frames}, {live.unreadable} unreadable"),
        ("Camera at", f"{live.distance_mm:.0f} mm"),
        ("Slits found", f"{100 * live.decode_yield:.0f} % in the last frame"),
        ("From writing to map", f"{1e3 * live.wait_s:.0f} ms in the middle; {timely}"),
        ("Last frame", live.reason or "fitted well"),
    ]
    facts = "".join(f"<dt>{escape(label)}</dt><dd>{escape(value)}</dd>" for label, value in pairs)
    if live.found is None:
        body = f"<section><p>Nothing measured yet: {escape(live.why)}.</p></section>"
    else:
        body = f"<section><h2>Defects so far</h2>{_defects(live.found)}</section>"
        body += f"<section><h2>Wall map so far</h2>{figure_html(live_map(live.found))}</section>"
    head = f"<h1>Live</h1><dl>{facts}</dl>"
    return page_html(
        "live", head, body, "Renewed every two seconds; the last page stays when the log ends.", _refresh()
    )


def _defects(found: Reconstruction) -> str:
    if not found.defects:
        return "<p>None.</p>"
    head = "".join(f'<th scope="col">{t}</th>' for t in ("Distance (mm)", "Clock", "Length", "Width", "Depth (mm)"))
    lines = "".join(
        f"<tr><td>{fixed(d.distance_mm, 1)}</td><td>{clock_position(d.theta_rad)}</td><td>{fixed(d.length_mm, 1)}</td>"
        f"<td>{fixed(d.width_mm, 1)}</td><td>{fixed(d.depth_mm, 2)} ± {fixed(d.depth_std_mm, 2)}</td></tr>"
        for d in found.defects[-MOST_DEFECTS:]
    )
    return f'<table class="health"><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>'


def live_map(found: Reconstruction) -> Picture:
    """The unrolled wall coloured by depth, drawn without a plot's cost."""
    import cv2

    touched = found.wall.touched()
    deviation = found.deviation_mm[:, touched]
    deepest = max([LEAST_RANGE_MM, *(d.depth_mm for d in found.defects)])
    columns = np.linspace(0, deviation.shape[1] - 1, min(deviation.shape[1], MAP_PX[0])).astype(int)
    some = np.array([line[columns] for (line,) in lines(deviation)])
    level = (np.clip(np.nan_to_num(some) / deepest, 0, 1) * 255).astype(np.uint8)
    bgr = cv2.applyColorMap(level, cv2.COLORMAP_CIVIDIS)
    bgr[~np.isfinite(some)] = UNSEEN_GREY
    file = cv2.imencode(".png", cv2.resize(bgr, MAP_PX, interpolation=cv2.INTER_NEAREST))[1].tobytes()
    ends = found.wall.z_mm[touched.start], found.wall.z_mm[touched.stop - 1]
    words = f"the wall from {ends[0]:.0f} to {ends[1]:.0f} mm, 12 o'clock at the top and again at the bottom"
    return Picture(
        file, "png", *MAP_PX, f"Map of {words}.", f"{words.capitalize()}; 0 to {deepest:.1f} mm deep, grey unseen."
    )
