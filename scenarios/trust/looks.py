"""Looks at targets from a CSV: which columns hold what, and every cell that cannot be a size, a hit or a signal."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError, model_validator

from scenarios.document import BadInput, shown
from scenarios.trust.columns import Table, hits, names, numbers, raise_faults
from sensor_model.settings import Settings

Row = dict[str, Any]


class PodQuestion(Settings):
    """Which columns hold what, and by which model."""

    size: str = Field("size", description="Column of true sizes; 0 is a place with nothing to find.")
    hit: tuple[str, ...] = Field((), description="Columns of hits (1) and misses (0), one for each look.")
    signal: tuple[str, ...] = Field((), description="Columns of signals, one for each look.")
    decision: float | None = Field(None, description="A signal above this is a hit.")
    left: float | None = Field(None, description="Signals at most this are only known to be so.")
    right: float | None = Field(None, description="Signals at least this are only known to be so.")
    noise_to: float | None = Field(None, gt=0, description="Signals of sizes up to this are noise too.")
    target: str | None = Field(None, description="Column that names the target, where it stands in several rows.")
    link: Literal["logit", "probit", "cloglog", "loglog"] = Field("logit", description="Shape of a hit/miss curve.")
    size_scale: Literal["log", "linear"] = Field("log", description="The curve's axis.")
    signal_scale: Literal["log", "linear"] = Field("linear", description="The signals' axis.")
    floor: bool = Field(False, description="Let a hit/miss curve start above 0.")
    ceiling: bool = Field(False, description="Let a hit/miss curve end below 1.")

    @model_validator(mode="after")
    def _one_kind(self) -> PodQuestion:
        if bool(self.hit) == bool(self.signal):
            raise ValueError("give --hit COLUMN for hits and misses, or --signal COLUMN for signals, and not both")
        if self.signal and self.decision is None:
            raise ValueError("--signal needs --decision VALUE: above it a signal is a hit")
        if self.signal and (self.floor or self.ceiling):
            raise ValueError("--floor and --ceiling are for hits and misses")
        if self.left is not None and self.right is not None and self.left >= self.right:
            raise ValueError(f"--left {self.left:g} must be less than --right {self.right:g}")
        return self


def question_of(given: Row) -> PodQuestion:
    """The question of some options.

    Raises:
        BadInput: for options that cannot be, each with its name.
    """
    try:
        return PodQuestion.model_validate(given)
    except ValidationError as error:
        lines = []
        for fault in error.errors():
            option = "".join(f"--{part}: got {shown(fault['input'])}; ".replace("_", "-") for part in fault["loc"][:1])
            lines.append(option + fault["msg"].removeprefix("Value error, "))
        raise BadInput(lines) from error


class Looks(NamedTuple):
    """Each look: the size and number of its target, and its hit (1 or 0) or signal."""

    size: np.ndarray
    target: np.ndarray
    value: np.ndarray


def read_looks(table: Table, question: PodQuestion) -> Looks:
    """Every look of every row; with several columns a cell may be empty: not looked at."""
    faults: list[str] = []
    columns = question.hit or question.signal
    size = numbers(table, question.size, faults, least=0.0)
    read = hits if question.hit else numbers
    values = np.stack([read(table, column, faults, empty=len(columns) > 1) for column in columns], axis=1)
    target = np.arange(len(table.rows))
    if question.target is not None:
        target = np.unique(names(table, question.target, faults), return_inverse=True)[1]
        faults += _torn_targets(table, question, target, size)
    raise_faults(faults)
    looked = ~np.isnan(values)
    row = np.nonzero(looked)[0]
    if not row.size:
        raise BadInput([f"{table.file}: no look at all in {', '.join(map(shown, columns))}"])
    return Looks(size[row], target[row], values[looked])


def _torn_targets(table: Table, question: PodQuestion, target: np.ndarray, size: np.ndarray) -> list[str]:
    """Rows whose target has another size further up."""
    first = np.unique(target, return_index=True)[1][target]
    torn = np.nonzero((size != size[first]) & np.isfinite(size) & np.isfinite(size[first]))[0]
    return [
        f"{table.file}:{table.lines[i]}: {question.size}: got {size[i]:g}; the same target has {size[first[i]]:g} on "
        f"line {table.lines[first[i]]}"
        for i in torn
    ]
