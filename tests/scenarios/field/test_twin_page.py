"""The twin page: made of the measurement alone, safe, repeatable, and used by pointer and by keyboard in a browser."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
from base64 import b64decode

import numpy as np
import pytest
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.field import twin_data, twin_page
from scenarios.field.twin_page import write_twin_page
from sensor_model.recording import write_frame_list

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# What a reader does, in order; what the page then says goes into its title, where the test reads it.
DRIVER = """
const said = [], note = () => said.push([chosen, Math.round(place), element("selected").textContent.slice(0, 16)]);
const key = (on, name) => on.dispatchEvent(new KeyboardEvent("keydown", { key: name, cancelable: true }));
document.querySelector("[data-defect='0']").click(); note();
element("place").value = 60; element("place").dispatchEvent(new Event("input")); note();
const { x, y } = onMap();
map.dispatchEvent(new MouseEvent("click", { clientX: map.getBoundingClientRect().left + x(defects[0].z),
  clientY: map.getBoundingClientRect().top + y(defects[0].theta) })); note();
key(map, "ArrowRight"); note();
key(map, "n"); note();
element("nearer").click(); said.push(Math.round(span));
key(map, "+"); key(map, "-"); element("whole").click(); said.push(Math.round(span));
const before = view.yaw; key(scene, "ArrowLeft"); said.push(view.yaw !== before);
const pixels = (canvas, context) => context.getImageData(0, 0, canvas.width, canvas.height).data.buffer;
const lit = (canvas, context) => new Set(new Uint32Array(pixels(canvas, context))).size;
said.push([lit(map, flat), lit(scene, ink), lit(series, plot)].every((colors) => colors > 20));
said.push(document.documentElement.scrollWidth <= window.innerWidth);
said.push(shots.length ? element("shot").naturalWidth > 0 || element("shot").src.length > 1000 : null);
document.title = JSON.stringify(said);
"""


def data_of(page):
    return json.loads(re.search(r'<script type="application/json" id="twin">(.*?)</script>', page, re.S)[1])


@pytest.fixture(scope="module")
def with_pictures(run_of, tmp_path_factory):
    """A run with its log, whose frames are pictures (plain ones), one of them damaged."""
    import cv2

    folder = tmp_path_factory.mktemp("pictures") / "run"
    run_of(folder, "sensing.frame_rate_hz=5", "drive.stages=[{to_mm: 60}]", "pipe.features=[]")
    log = folder / "recording"
    stamps = np.array([int(path.stem) for path in (log / "cam0" / "data").glob("*.npy")])
    stamps.sort()
    for k, file in enumerate(write_frame_list(log, stamps, ".png")):
        cv2.imwrite(str(log / file), np.full((1232, 1664, 3), 10 * (k + 1), np.uint8))
    (log / "cam0" / "data" / f"{stamps[2]}.png").write_bytes(b"no picture")
    return folder, len(stamps)


def test_the_measurement_alone_makes_a_page(found_folder, tmp_path):
    page = tmp_path / "twin.html"
    done = CliRunner().invoke(app, ["twin-page", str(found_folder), "-o", str(page)])
    assert done.output == f"page: {page}\n"
    text = page.read_text()
    assert not re.search(r"""(src|href)=["'](?!data:|#)|https?://|url\(""", text)
    assert "1 defect between" in text
    assert "holds no camera pictures" in text
    data = data_of(text)
    wall = data["wall"]
    level = np.frombuffer(b64decode(wall["level"]), np.uint8).reshape(wall["around"], wall["along"])
    depth = wall["low"] + (wall["high"] - wall["low"]) * (level.astype(float) - 1) / (len(wall["shades"]) - 1)
    assert depth[120, int((150 - wall["start"]) / wall["cell"])] == pytest.approx(5, abs=0.2)
    assert level[0, int((150 - wall["start"]) / wall["cell"])] == 0  # under the strut
    (defect,) = data["defects"]
    assert "depth 5.0 (5.0 to 5.1) mm" in defect["words"]
    assert (data["slip"], data["joints"]) == (None, [40.5])
    again = tmp_path / "again.html"
    write_twin_page(found_folder, again)
    assert again.read_text() == text


def test_pictures_and_slip_come_from_the_log(with_pictures, monkeypatch):
    folder, frames = with_pictures
    write_twin_page(folder, folder / "twin.html")
    data = data_of((folder / "twin.html").read_text())
    assert len(data["shots"]) == frames - 1
    assert "1 pictures could not be read" in (folder / "twin.html").read_text()
    z = [shot["z"] for shot in data["shots"]]
    assert z == sorted(z)
    assert z[-1] == pytest.approx(60, abs=1)
    assert b64decode(data["shots"][0]["jpeg"])[:2] == b"\xff\xd8"
    assert np.abs(data["slip"]).max() < 0.5  # a gantry's wheels do not slip
    assert len(data["slip"][0]) == len(data["path"]["z"])
    few = sum(len(b64decode(shot["jpeg"])) for shot in data["shots"]) // 2
    monkeypatch.setattr(twin_data, "MOST_PICTURE_BYTES", few)
    write_twin_page(folder, folder / "twin.html")
    kept = [len(b64decode(shot["jpeg"])) for shot in data_of((folder / "twin.html").read_text())["shots"]]
    assert 0 < sum(kept) <= few


def hostile(folder, found_folder):
    """The same run, with markup wherever a stranger can write."""
    shutil.copytree(found_folder, folder)
    file = folder / "reconstruction" / "defects.csv"
    rows = list(csv.reader(file.read_text().splitlines()))
    rows[1][rows[0].index("disposition")] = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    with file.open("w", newline="") as out:
        csv.writer(out).writerows(rows)
    return folder


def test_all_text_is_escaped(found_folder, tmp_path):
    folder = hostile(tmp_path / "<b>run & co", found_folder)
    write_twin_page(folder, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert "<script>alert" not in text
    assert "<img src=x" not in text
    assert "<h1>&lt;b&gt;run &amp; co</h1>" in text


def test_a_long_pipe_is_drawn_with_its_deepest_cells():
    values = np.zeros((4, 7))
    values[2, 3], values[0, 6], values[3] = 5.0, np.nan, np.nan
    np.testing.assert_array_equal(twin_data._deepest_of(values, 2, 3), [[0.0, 0.0, 0.0], [0.0, 5.0, 0.0]])
    assert np.isnan(twin_data._deepest_of(np.full((2, 2), np.nan), 1, 2)).all()
    np.testing.assert_array_equal(twin_data.thinned(np.arange(10), 4), [0, 3, 6, 9])


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine to open the page with")
@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("kind", ["pictures", "hostile"])
def test_the_page_is_used_in_a_browser(with_pictures, found_folder, tmp_path, monkeypatch, width, kind):
    folder = hostile(tmp_path / "run", found_folder)
    if kind == "pictures":
        shutil.copytree(with_pictures[0] / "recording", folder / "recording")
        shutil.copyfile(
            with_pictures[0] / "reconstruction" / "trajectory.tum", folder / "reconstruction" / "trajectory.tum"
        )
    driven = tmp_path / "twin.js"
    driven.write_text(twin_page.SCRIPT.read_text() + DRIVER)
    monkeypatch.setattr(twin_page, "SCRIPT", driven)
    write_twin_page(folder, tmp_path / "page.html")
    words = (
        f"{CHROMIUM} --headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking "
        f"--disable-component-update --disable-sync --enable-logging=stderr --user-data-dir={tmp_path / 'profile'} "
        f"--window-size={width},1000 --dump-dom {(tmp_path / 'page.html').as_uri()}"
    ).split()
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "CONSOLE" not in done.stderr
    said = json.loads(re.search("<title>(.*?)</title>", done.stdout)[1].replace("&gt;", ">"))
    picked, moved, clicked, stepped, following, near, whole, turned, drawn, fits, shot = said
    assert picked[0] == clicked[0] == following[0] == 0
    assert picked[1] == clicked[1] == following[1] == pytest.approx(150, abs=1)
    assert picked[2] == "Defect 1: 150 mm"
    assert moved[1] == pytest.approx(60, abs=20)
    assert stepped[1] > clicked[1]
    assert near < whole
    assert turned and drawn and fits  # noqa: PT018
    assert shot is (True if kind == "pictures" else None)
