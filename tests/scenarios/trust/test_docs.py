"""What docs/trust.md shows is what happens."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenarios.paper import fig16, table3
from scenarios.trust import gauge, pod_page
from scenarios.trust.looks import question_of
from scenarios.trust.pod import pod_of

DOCS = (Path(__file__).resolve().parents[3] / "docs" / "trust.md").read_text()


def shown(command: str) -> str:
    """The output below a command, without the line that says where the files are."""
    block = DOCS.split(f"$ pipetwin {command}")[1].split("```")[0]
    return block.split("\n", 1)[1].rstrip().rsplit("\n", 1)[0]


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("example5_hitmiss_repeated", {"size": "2", "hit": ("4", "8", "12")}),
        (
            "example1_ahat",
            {"signal": ("Test B",), "decision": 200.0, "left": 50.0, "right": 1375.0, "noise_to": 8.5},
        ),
    ],
)
def test_pod(name, given, shared):
    file = shared / "reference" / "pod" / f"{name}.csv"
    assert shown(f"pod {name}") == pod_page.words(pod_of(file, question_of(given)))


def test_gauge(shared):
    file = shared / "reference" / "gauge" / "aiag_msa_10x3x3.csv"
    assert shown("gauge aiag") == gauge.words(gauge.gauge_of(file, "part", "operator", "y"))


def test_the_paper():
    assert shown("paper table3") == table3.words(table3.table3_rows())
    assert shown("paper fig16") == fig16.words(fig16.fig16_rows())


def test_every_file_it_names_exists():
    root = Path(__file__).resolve().parents[3]
    named = {word for word in DOCS.replace("|", " ").split("`") if word.endswith(".py") and " " not in word}
    assert len(named) > 10
    for name in named:
        assert (root / name).exists() or (root / "algorithms" / "trust" / name).exists(), name
