"""The health of a log: everything about it that its result depends on, each with a verdict and what it means."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

from algorithms.method import Method
from algorithms.types import Reconstruction
from scenarios.field.finding import WORST, Finding, Verdict, worst
from scenarios.field.health_camera import camera_findings
from scenarios.field.health_clock import clock_findings, rates_hz
from scenarios.field.health_imu import imu_findings
from scenarios.field.health_rings import ring_figures, ring_findings
from scenarios.field.health_wheels import wheel_findings
from scenarios.field.look import Watched
from sensor_model.recording import Recording


class Health(NamedTuple):
    """All findings, the worst first, and the figures behind them."""

    verdict: Verdict
    findings: tuple[Finding, ...]
    figures: dict[str, float | int | None]


def examine(
    recording: Recording, method: Method, watched: Watched, found: Reconstruction | None, remarks: list[str]
) -> Health:
    """Look at a log and at what its frames gave; `remarks` are its reader's."""
    findings = [
        Finding("log", "as read", "weak", remark, "The figures rest on less than a whole log.") for remark in remarks
    ]
    findings += clock_findings(recording)
    findings += camera_findings(recording, method, watched)
    findings += imu_findings(recording)
    findings += wheel_findings(recording)
    findings += ring_findings(recording, watched, found)
    findings.sort(key=lambda one: WORST.index(one.verdict))  # stable: within a verdict as they were found
    figures = {**rates_hz(recording), **ring_figures(watched, found)}
    return Health(worst(findings), tuple(findings), figures)


def write_health(health: Health, file: Path) -> None:
    """Write all of it as JSON."""
    said = {
        "verdict": health.verdict,
        "findings": [one._asdict() for one in health.findings],
        "figures": health.figures,
    }
    file.write_text(json.dumps(said, indent=1, allow_nan=False) + "\n")
