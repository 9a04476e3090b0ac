"""The report as its reader has it: complete, honest about what is missing, safe, self-contained, and repeatable."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from algorithms.reconstruct import begin, finish, see, step
from algorithms.types import Episode
from scenarios.report.alarm_table import alarms
from scenarios.report.comparison import quantities, rows
from scenarios.report.numbers import figure, score_figure, signed
from scenarios.report.page import write_report
from scenarios.report.statements import never_seen, verdict
from scenarios.run import Run, Sample
from scenarios.scenario import Scenario, nominal_pipe
from scenarios.score import MEANINGS, FrameTally, score, tally_frame
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
POCKET = {"kind": "pocket", "distance_mm": 150, "clock_deg": "4:00", "length_mm": 40, "width_mm": 30, "depth_mm": 4}
UNDER_THE_STRUT = {"kind": "pit", "distance_mm": 190, "clock_deg": "12:00", "diameter_mm": 14, "depth_mm": 3}


def _run(folder: Path, features: list[dict]) -> Run:
    """A short gantry scan at `points` fidelity."""
    scenario = Scenario.model_validate(
        {
            "name": "short",
            "why": 'Tags <script>alert("x")</script> & signs.',
            "pipe": {
                "inner_radius_mm": 76.2,
                "wall_thickness_mm": 7.5,
                "start_mm": -100,
                "end_mm": 400,
                "features": features,
            },
            "drive": {"kind": "gantry", "stages": [{"to_mm": 130}], "speed_mm_s": 80, "offset_mm": [2, -1]},
            "sensing": {"fidelity": "points"},
        }
    )
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(0, "drive"))
    list(sense(truth, scenario.rig, scenario.rig, nominal_pipe(scenario), scenario.sensing, 0, folder))
    recording = open_recording(folder)
    T_true = truth.pose_at(np.minimum(recording.frame_stamps_ns / 1e9, truth.time_s[-1]))
    state, tally = begin(recording.rig, recording.pipe, scenario.method), FrameTally(truth.pipe, scenario.rig)
    for index in range(len(recording)):
        seen = see(recording[index], recording.rig, scenario.method)
        tally_frame(tally, step(state, recording.frame(index), seen), T_true[index])
    found = finish(state)
    sample = Sample(0, 0.0, see(recording[0], recording.rig, scenario.method))
    return Run(recording, found, (sample,), scenario, truth, score(found, truth, tally))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """One defect found, one hidden by the strut, one call too many, and one frame not registered."""
    run = _run(tmp_path_factory.mktemp("recording"), [POCKET, UNDER_THE_STRUT])
    (hit,) = run.found.defects
    stray = replace(hit, start_mm=210.0, length_mm=8.0, width_mm=6.0, depth_mm=0.6, theta_rad=4.0, wall_loss_pct=8.0)
    path = run.found.trajectory
    registered, reason = path.registered.copy(), list(path.reason)
    registered[3], reason[3] = False, "too few points: 12 < 40"
    path = replace(path, registered=registered, reason=tuple(reason))
    found = replace(run.found, defects=(hit, stray), trajectory=path)
    result = replace(run.score, false_calls=1, frames_registered=run.score.frames - 1)
    return replace(run, found=found, score=result)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A pipe without defects."""
    return _run(tmp_path_factory.mktemp("bare"), [])


@pytest.fixture(scope="module")
def page(whole: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "report.html"
    write_report(whole, file)
    return file


def _words(page: Path) -> str:
    """What the page says, without tags, styles and pictures."""
    text = re.sub(r"<style>.*?</style>", " ", page.read_text(), flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", text))


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict]] = []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.found.append((tag, dict(attrs)))


def _tags(page: Path) -> list[tuple[str, dict]]:
    parser = _Tags()
    parser.feed(page.read_text())
    return parser.found


def test_the_verdict_comes_first_and_every_defect_has_its_row(whole: Run, page: Path) -> None:
    kinds = [row.kind for row in rows(whole)]
    assert kinds == ["found", "missed", "false call"]
    words = _words(page)
    assert verdict(whole).startswith("1 of 2 defects found, 1 false call. Worst errors: length ")
    assert words.index("1 of 2 defects found") < words.index("What was scanned") < words.rindex("measured beside true")
    for said in ("not found by the measurement", "no true defect here", "1 pocket", "2 pit"):
        assert said in words
    assert page.read_text().count("<tbody class=") == 3


def test_measured_true_and_error_agree(whole: Run) -> None:
    found, missed, false_call = rows(whole)
    for quantity in quantities(found, whole):
        assert quantity.error == pytest.approx(quantity.measured - quantity.true)
        assert quantity.std > 0
    length = next(q for q in quantities(found, whole) if q.name == "length")
    assert abs(length.error) == pytest.approx(whole.score.length_error_mm_max)
    assert np.isnan([q.measured for q in quantities(missed, whole)]).all()
    assert np.isnan([q.true for q in quantities(false_call, whole)]).all()


def test_what_was_not_seen_and_what_is_an_oracle_is_said(whole: Run, page: Path) -> None:
    words = _words(page)
    for said in ("What was not seen", "Strut: it hides 37°", "Shadow under steep edges", "too few points: 12 &lt; 40"):
        assert said in words
    assert "chooses the threshold with the TRUE size" in words
    ((first, last),) = never_seen(whole)
    assert (first[:3], last[:3]) == ("11:", "12:")
    assert f"{first} to {last}" in words


def test_every_score_has_its_meaning(page: Path) -> None:
    words = _words(page)
    for name, meaning in MEANINGS.items():
        assert name in words
        assert meaning.replace("'", "&#x27;") in words


def test_a_scenarios_words_stay_words(page: Path) -> None:
    text = page.read_text()
    assert "Tags &lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt; &amp; signs." in text
    assert "<script" not in text


def test_the_page_needs_no_other_file(page: Path) -> None:
    assert not re.search(r"https?://|//[a-z]+\.|@import|url\(", re.sub(r"base64,[\w+/=]+", "", page.read_text()))
    for tag, attributes in _tags(page):
        assert tag not in ("script", "link", "iframe", "object")
        assert not attributes.get("src", "data:").partition("data:")[0]
        assert attributes.get("href", "#").startswith("#")
    assert page.stat().st_size < 1_500_000


def test_pictures_can_be_read_by_those_who_cannot_see_them(page: Path) -> None:
    pictures = [attributes for tag, attributes in _tags(page) if tag == "img"]
    assert len(pictures) >= 8  # map, three profiles, space, pose, path, yield
    assert all(len(picture["alt"]) > 40 for picture in pictures)
    headings = [tag for tag, _ in _tags(page) if re.fullmatch("h[1-6]", tag)]
    assert headings[0] == "h1"
    assert headings.count("h1") == 1


def test_the_same_run_gives_the_same_bytes(whole: Run, page: Path, tmp_path: Path) -> None:
    write_report(whole, tmp_path / "again.html")
    assert (tmp_path / "again.html").read_bytes() == page.read_bytes()


def test_a_pipe_without_defects(bare: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenarios.report.canvas.DPI", 50)
    assert verdict(bare) == "The pipe has no defect; no false call."
    write_report(bare, tmp_path / "report.html")
    words = _words(tmp_path / "report.html")
    assert "n/a (no defect in the pipe)" in words
    assert "No defect in the pipe, and none called." in words
    assert not re.search(r"\bnan\b|\bNone\b|\binf\b", words.partition("Every setting")[0])


def test_slip_alarms_stand_beside_what_truly_slipped(bare: Run) -> None:
    assert "gives no slip alarm" in alarms(bare)
    slipping = bare.truth.slip_mm_s.copy()
    slipping[:, 1] = 2.0
    end_ns = round(bare.truth.time_s[-1] * 1e9)
    stated = (Episode("slip", "wheel 2", end_ns - 10**9, end_ns, 3.1), Episode("gap", "imu", 0, 10**8, 0.1))
    run = replace(bare, truth=replace(bare.truth, slip_mm_s=slipping), found=replace(bare.found, episodes=stated))
    rows = re.findall(r"<tr><td>.*?</tr>", alarms(run))
    assert "<td>+0.1 s</td><td>n/a</td>" in rows[0]
    assert "<td>wheel 2</td>" in rows[1]
    stated_mm, true_mm = re.findall(r"<td>([+-][0-9.]+) mm</td>", rows[1])
    assert float(stated_mm) == 3.1
    assert float(true_mm) == pytest.approx(2.0 * min(2.0, bare.truth.time_s[-1]), abs=0.1)


def test_a_scan_that_finds_nothing(whole: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenarios.report.canvas.DPI", 50)
    none = dict.fromkeys([name for name, value in vars(whole.score).items() if "error_mm" in name or name[:2] == "eq"])
    result = replace(whole.score, defects_found=0, false_calls=0, depth_bias_mm=None, **none)
    run = replace(whole, found=replace(whole.found, defects=()), score=result, samples=())
    assert verdict(run) == "0 of 2 defects found, no false call."
    write_report(run, tmp_path / "report.html")
    assert "n/a (no defect found)" in _words(tmp_path / "report.html")


def test_numbers() -> None:
    assert [figure(v) for v in (None, float("nan"), 3, 0.0123456, 12345.6, 0.0)] == [
        "n/a",
        "n/a",
        "3",
        "0.0123",
        "12346",
        "0",
    ]
    assert [signed(v, 1) for v in (1.26, -1.26, -0.01)] == ["+1.3", "−1.3", "0.0"]
    assert score_figure("seen_share", 0.853) == "85.3 %"
    assert score_figure("center_variance_mm2", 0.0527) == "0.0527 mm²"
    assert score_figure("roll_rms_deg", 0.25) == "0.25°"


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine to open the page with")
def test_the_page_opens_in_a_browser(page: Path, tmp_path: Path) -> None:
    words = (
        f"{CHROMIUM} --headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking "
        f"--disable-component-update --disable-sync --enable-logging=stderr --user-data-dir={tmp_path / 'profile'} "
        f"--window-size=1280,2000 --screenshot={tmp_path / 'page.png'} {page.as_uri()}"
    ).split()
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "CONSOLE" not in done.stderr
    from PIL import Image

    with Image.open(tmp_path / "page.png") as picture:
        assert picture.size == (1280, 2000)
        assert len(picture.convert("RGB").getcolors(2**24)) > 50
