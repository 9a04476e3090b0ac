"""`pipetwin pod`, `gauge`, `paper table3` and `fig16` as a person uses them."""

from __future__ import annotations

import csv
import json
import subprocess
import sys

import numpy as np
import pytest

from algorithms.trust.curve import one_sided_drop, size_bound
from algorithms.trust.exact_bounds import rate_of
from algorithms.trust.feature_class import CLASSES
from algorithms.trust.performance import confusion_of, identification_of, unity_of
from scenarios.document import BadInput
from scenarios.paper.fig16 import c4, fig16_rows, run_fig16
from scenarios.paper.fig16 import words as fig16_words
from scenarios.paper.table3 import run_table3, table3_rows
from scenarios.paper.table3 import words as table3_words
from scenarios.report.calibration_page import calibration_page
from scenarios.trust.columns import read_table
from scenarios.trust.gauge import figures, gauge_of, run_gauge
from scenarios.trust.gauge import words as gauge_words
from scenarios.trust.looks import question_of
from scenarios.trust.pod import pod_of
from scenarios.trust.pod_page import curve_rows, json_figures, run_pod, words
from scenarios.trust.trade import Trade, trade_sections


def hits_csv(tmp_path, n=120, seed=0):
    """Looks by two probes at pits of known depth, the second probe missing some; ten blank places."""
    rng = np.random.default_rng(seed)
    depth = np.round(np.concatenate([np.zeros(10), rng.uniform(0.3, 6, n)]), 3)
    pod = np.where(depth > 0, 1 / (1 + np.exp(-(depth - 2) * 3)), 0.05)
    looks = (rng.random((2, depth.size)) < pod).astype(int)
    second = ["" if k % 9 == 0 else str(v) for k, v in enumerate(looks[1])]
    file = tmp_path / "pits.csv"
    lines = [f"{d},{a},{b}" for d, a, b in zip(depth, looks[0], second, strict=True)]
    file.write_text("\n".join(["depth_mm,probe A,probe B", *lines]) + "\n")
    return file


def ask(**given):
    return question_of(given)


def test_pod_writes_a_page_figures_and_the_curve(tmp_path):
    pod = run_pod(hits_csv(tmp_path), ask(size="depth_mm", hit=("probe A", "probe B")), tmp_path / "out")
    said = json.loads((tmp_path / "out" / "pod.json").read_text())
    assert said == json.loads(json.dumps(json_figures(pod)))
    assert said["looks_per_target"] == [1, 2]
    assert said["targets"] == 120
    assert said["false_calls"]["n"] == 10 + 8  # blank places, by each probe that looked
    assert said["a50"] < said["a90"] < said["a90_95"][0]["size"] < said["a90_95"][1]["size"]
    rows = list(csv.DictReader((tmp_path / "out" / "curve.csv").read_text().splitlines()))
    curve, lower = (np.array([float(row[key]) for row in rows]) for key in ("pod", "pod_lower_95"))
    assert np.all(np.diff(curve) > 0)
    assert np.all(lower <= curve)
    size = np.array([float(row["size"]) for row in rows])
    assert np.interp(0.9, lower, size) == pytest.approx(said["a90_95"][0]["size"], rel=0.01)
    html = (tmp_path / "out" / "report.html").read_text()
    assert html.count("<img") == 1
    assert "likelihood ratio 2.706" in html
    text = words(pod)
    assert text.startswith(f"a90 is {said['a90']:.4g}, a90/95 {said['a90_95'][0]['size']:.4g}")
    assert "1 to 2 looks each" in text
    run_pod(hits_csv(tmp_path), ask(size="depth_mm", hit=("probe A", "probe B")), tmp_path / "out")  # replaces it


def test_the_same_looks_in_long_form_say_the_same(tmp_path):
    wide = hits_csv(tmp_path)
    rows = list(csv.DictReader(wide.read_text().splitlines()))
    long = tmp_path / "long.csv"
    lines = [
        f"{k};{row['depth_mm']};{'hit' if row[probe] == '1' else 'miss'}"
        for k, row in enumerate(rows) for probe in ("probe A", "probe B") if row[probe]
    ]  # fmt: skip
    long.write_text("\n".join(["pit;depth;found", *lines]))
    one = pod_of(wide, ask(size="depth_mm", hit=("probe A", "probe B")))
    other = pod_of(long, ask(size="depth", hit=("found",), target="pit"))
    assert one.figures["a90_95"][0]["size"] == pytest.approx(other.figures["a90_95"][0]["size"], rel=1e-9)


def test_the_handbooks_files_are_read_as_they_are(shared):
    folder = shared / "reference" / "pod"
    probes = pod_of(folder / "example5_hitmiss_repeated.csv", ask(size="2", hit=("4", "8", "12")))
    assert probes.figures["a90_95"][1]["size"] == pytest.approx(0.2621, abs=5e-5)
    given = {"signal": ("Test B",), "decision": 200.0, "left": 50.0, "right": 1375.0, "noise_to": 8.5}
    signals = pod_of(folder / "example1_ahat.csv", ask(**given))
    assert signals.figures["a90_95"][2]["size"] == pytest.approx(13.68, abs=5e-3)
    assert signals.figures["noise"]["quantiles"]["99.9 %"] == pytest.approx(264.6, abs=0.05)
    at = min(signals.figures["decisions"], key=lambda row: abs(row["decision"] - 200))
    assert at["a90"] == pytest.approx(signals.figures["a90"], rel=0.02)
    for name, sign in (("a90", 1), ("a90_95", 1), ("false_call_probability", -1)):
        assert np.all(sign * np.diff([row[name] for row in signals.figures["decisions"]]) > 0)
    assert (signals.figures["at_most_left"], signals.figures["at_least_right"]) == (3, 1)
    with pytest.raises(BadInput, match=r":1: column 'VERIFIED' stands there 3 times; give a number: 4, 8, 12"):
        pod_of(folder / "example5_hitmiss_repeated.csv", ask(size="2", hit=("VERIFIED",)))


def test_signals_have_a_page_with_both_pictures(tmp_path):
    rng = np.random.default_rng(0)
    size = rng.uniform(1, 10, 60)
    signal = np.exp(0.4 + 0.8 * np.log(size) + 0.2 * rng.standard_normal(60))
    file = tmp_path / "signals.csv"
    file.write_text("size,s\n" + "\n".join(f"{a:.4f},{s:.4f}" for a, s in zip(size, signal, strict=True)))
    pod = run_pod(file, ask(signal=("s",), decision=2.5, signal_scale="log"), tmp_path / "out")
    assert pod.figures["a90"] == pytest.approx(np.exp((np.log(2.5) - 0.4 + 1.2816 * 0.2) / 0.8), rel=0.1)
    assert (tmp_path / "out" / "report.html").read_text().count("<img") == 2


def test_repeated_signals_count_once_a_target_and_blanks_are_noise(tmp_path):
    rng = np.random.default_rng(1)
    size = np.concatenate([np.zeros(12), rng.uniform(1, 10, 50)])
    one = np.where(size > 0, 1 + 2 * np.log(np.maximum(size, 1)), 0.5) + 0.6 * rng.standard_normal(62)
    file = tmp_path / "signals.csv"
    file.write_text("size,a,b\n" + "\n".join(f"{a:.4f},{s:.4f},{s:.4f}" for a, s in zip(size, one, strict=True)))
    once, twice = (pod_of(file, ask(signal=columns, decision=2.0)) for columns in (("a",), ("a", "b")))
    assert twice.figures["a90_95"][0]["size"] == pytest.approx(once.figures["a90_95"][0]["size"], rel=1e-6)
    free = next(
        bound for bound in twice.figures["a90_95"] if bound["convention"].startswith("if repeats were independent")
    )
    assert once.figures["a90"] < free["size"] < once.figures["a90_95"][0]["size"]
    assert once.figures["noise"]["n"] == 12
    assert once.figures["noise"]["mean"] == pytest.approx(0.5, abs=0.5)


def test_separated_hits_are_said_to_be_and_have_no_slope(tmp_path):
    file = tmp_path / "few.csv"
    file.write_text("size,hit\n" + "\n".join(f"{k},{int(k > 4)}" for k in range(1, 9)))
    pod = run_pod(file, ask(hit=("hit",)), tmp_path / "out")
    said = json.loads((tmp_path / "out" / "pod.json").read_text())
    assert said["outcome"] == "separated"
    assert said["a90"] is None
    assert "slope" not in said
    assert words(pod).startswith("No curve: separated.")
    assert not (tmp_path / "out" / "curve.csv").exists()


def test_a_floor_is_fitted_where_asked(tmp_path):
    pod = pod_of(hits_csv(tmp_path, 400), ask(size="depth_mm", hit=("probe A",), floor=True))
    assert 0 < pod.figures["floor"] < 0.2
    assert pod.figures["ceiling"] == 1.0
    for row in curve_rows(pod)[::100]:  # between the PODs at which the bound was sought the curve is drawn smooth
        if 0.1 < row["pod_lower_95"] < 0.95:
            assert size_bound(pod.curve, row["pod_lower_95"], one_sided_drop(0.95)) <= row["size"] * 1.03


@pytest.mark.parametrize(
    ("text", "given", "fault"),
    [
        ("", {}, "is empty"),
        ("size,hit\n", {}, "has a head and no rows"),
        ("size,hit\n1,1\n2\n", {}, ":3: got 1 cells; the head has 2"),
        ("size,hit\n1,1\nx,0\n", {}, ":3: size: got 'x'; must be a finite number of at least 0"),
        ("size,hit\n1,1\n-2,0\n", {}, ":3: size: got '-2'"),
        ("size,hit\n1,1\nnan,0\n", {}, ":3: size: got 'nan'"),
        ("size,hit\n1,1\n2,maybe\n", {}, ":3: hit: got 'maybe'; must be one of 1, hit"),
        ("size,hit\n1,1\n2,\n", {}, ":3: hit: got ''"),
        ("size,hti\n1,1\n", {}, "no column 'hit'; there are 'size', 'hti'; did you mean 'hti'"),
        ("size,hit,p\n1,1,a\n2,0,a\n", {"target": "p"}, ":3: size: got 2; the same target has 1 on line 2"),
        ("size,a,b\n1,,\n2,NA,\n", {"hit": ("a", "b")}, "no look at all"),
        ("size,hit\n1,1\n", {"hit": ()}, "give --hit COLUMN"),
        ("size,s\n1,1\n", {"hit": (), "signal": ("s",)}, "needs --decision"),
        ("size,hit\n1,1\n", {"left": 5.0, "right": 4.0}, "--left 5 must be less than --right 4"),
        ("size,hit\n1,1\n", {"noise_to": -1.0}, "--noise-to: got -1.0"),
        ("size,s\n1,0\n2,1\n", {"hit": (), "signal": ("s",), "decision": 1.0, "signal_scale": "log"}, "greater than 0"),
    ],
)
def test_what_cannot_be_used_is_said_with_its_place(tmp_path, text, given, fault):
    file = tmp_path / "a.csv"
    file.write_text(text)
    with pytest.raises(BadInput) as told:
        pod_of(file, question_of({"hit": ("hit",), **given}))
    assert fault in str(told.value)


def test_one_point_all_hits_and_nothing_but_blanks_are_named(tmp_path):
    file = tmp_path / "a.csv"
    for rows, outcome in (("3,1", "too few sizes"), ("1,1\n2,1\n3,1", "all hits"), ("0,0\n0,1", "too few sizes")):
        file.write_text(f"size,hit\n{rows}\n")
        pod = pod_of(file, ask(hit=("hit",)))
        assert pod.figures["outcome"] == outcome
        assert words(pod).startswith(f"No curve: {outcome}")


def test_files_that_are_no_table_are_named(tmp_path):
    with pytest.raises(BadInput, match="No such file"):
        read_table(tmp_path / "none.csv")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="UTF-8"):
        read_table(tmp_path / "bytes.csv")
    (tmp_path / "many.csv").write_text("size,hit\n" + "x,1\n" * 50)
    with pytest.raises(BadInput, match="and 30 more"):
        pod_of(tmp_path / "many.csv", ask(hit=("hit",)))


# ---- gauge


def gauge_csv(tmp_path, skip=()):
    rng = np.random.default_rng(0)
    lines = ["defect,robot,depth"]
    for part in range(6):
        for operator in range(3):
            for trial in range(3):
                if (part, operator, trial) not in skip:
                    value = part + 0.1 * operator + rng.normal(0, 0.1)
                    lines.append(f"d{part},r{operator},{value:.4f}")
    file = tmp_path / "gauge.csv"
    file.write_text("\n".join(lines))
    return file


def test_gauge_writes_a_page_and_figures(tmp_path):
    gauge = run_gauge(gauge_csv(tmp_path), "defect", "robot", "depth", tmp_path / "out")
    said = json.loads((tmp_path / "out" / "gauge.json").read_text())
    assert said == json.loads(json.dumps(figures(gauge)))
    assert said["variation"][0]["standard_deviation"] == pytest.approx(0.1, rel=0.3)
    assert "<img" in (tmp_path / "out" / "report.html").read_text()
    assert gauge_words(gauge).startswith("The gauge takes ")


def test_unequal_numbers_of_trials_are_named_one_by_one(tmp_path):
    with pytest.raises(BadInput) as told:
        gauge_of(gauge_csv(tmp_path, skip={(2, 1, 0), (4, 0, 1)}), "defect", "robot", "depth")
    assert len(told.value.lines) == 2
    assert "part d2, operator r1: got 2 trials, most others 3" in told.value.lines[0]


def test_a_gauge_of_one_operator_is_refused(tmp_path):
    (tmp_path / "one.csv").write_text("part,operator,value\na,x,1\na,x,2\nb,x,3\nb,x,4\n")
    with pytest.raises(BadInput, match="at least 2 parts x 2 operators x 2 trials"):
        gauge_of(tmp_path / "one.csv", "part", "operator", "value")


# ---- the paper


def test_table_3_does_not_follow_from_table_2(shared):
    said = json.loads((shared / "reference" / "answers.json").read_text())["paper_table2"]
    rows = table3_rows()
    assert [row["standard_mm"] for row in rows] == pytest.approx(said["recomputed_u_S_over_sqrt6"], abs=5e-5)
    assert [row["expanded_t_mm"] for row in rows] == pytest.approx(said["recomputed_U95_t5"], abs=5e-4)
    assert [row["paper_standard_mm"] for row in rows] == said["table3_published_u"]
    assert {row["verdict"] for row in rows} == {"does not follow"}
    assert rows[0]["mean_mm"] == pytest.approx(70.2)


def test_fig_16_ends_where_eq_31_does_and_its_fall_is_the_divisor():
    rows = fig16_rows()
    assert len(rows) == 15
    for row in table3_rows():
        last = next(r for r in rows if r["dimension"] == row["dimension"] and r["scans"] == 6)
        assert last["standard_mm"] == pytest.approx(row["standard_mm"], rel=1e-12)
    flat = [row["unbiased_mm"] for row in rows if row["dimension"] == "length"]
    assert max(flat) / min(flat) < 1.02
    assert c4(2) == pytest.approx(0.797885, abs=1e-6)
    assert c4(6) == pytest.approx(0.951533, abs=1e-6)


def test_the_papers_folders_hold_what_is_printed(tmp_path):
    assert json.loads(json.dumps(run_table3(tmp_path / "t"))) == json.loads(
        (tmp_path / "t" / "table3.json").read_text()
    )
    run_fig16(tmp_path / "f")
    assert (tmp_path / "f" / "fig16.png").stat().st_size > 10_000
    assert "does not follow" in table3_words(table3_rows())
    assert "Table 2 itself holds: Eqs 29 and 30 give its Err to 0.0" in table3_words(table3_rows())
    assert "sqrt(m)" in fig16_words(fig16_rows())


# ---- the trade


def test_the_trades_statements_are_a_page():
    rng = np.random.default_rng(0)
    true = rng.uniform(1, 9, 80)
    measured = true + rng.normal(0, 0.6, 80)
    names = [CLASSES[k % 3] for k in range(80)]
    trade = Trade(
        measured,
        true,
        10.0,
        unity_of(measured, true, 10.0),
        confusion_of(names, [*names[1:], names[0]], CLASSES),
        identification_of(np.ones(80, bool), np.arange(80) > 10),
        rate_of(2, 1500.0),
    )
    html = calibration_page("Performance", "", "", True, trade_sections(trade))
    assert "2 false calls on 1500 m: 0.0013 per metre, at most 0.0042" in html
    assert "informative" in html.lower()
    assert html.count("<img") == 1


# ---- the command line


def test_the_commands_print_and_say_bad_input_with_status_2(tmp_path):
    pipetwin = [sys.executable, "-m", "scenarios.cli"]
    hits_csv(tmp_path)
    words_given = ["pod", "pits.csv", "--size", "depth_mm", "--hit", "probe A", "--json"]
    done = subprocess.run([*pipetwin, *words_given], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["outcome"] == "curve"
    assert (tmp_path / "pod" / "pits" / "report.html").is_file()
    done = subprocess.run([*pipetwin, "gauge", "pits.csv"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("pits.csv:1: no column 'part'")
    assert done.stderr.count("\n") == 1
