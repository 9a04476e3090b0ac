"""What the cells of a ledger may hold, looked at before it is believed: such a file may be damaged, or a stranger's."""

from __future__ import annotations

import json
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from scenarios.document import shown


class DamagedCell(Exception):
    """A cell that holds something else than it should."""


class _Identity(TypedDict):
    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]  # pydantic's own way to say it

    paths: list[str]
    factors: dict[str, dict[str, Any]]
    record: list[str]


FACTS: dict[str, TypeAdapter] = {
    "identity": TypeAdapter(_Identity),
    "pace": TypeAdapter(dict[str, float]),
    "methods": TypeAdapter(list[str]),
    **dict.fromkeys(("name", "why"), TypeAdapter(str)),
    **dict.fromkeys(("planned", "repeats"), TypeAdapter(int)),
}


def plain_of(cell: str, holds: TypeAdapter, what: str) -> Any:
    """The data of a cell's JSON, as it stands there.

    Raises:
        DamagedCell: with the cell, for what is no JSON or does not hold what is expected.
    """
    try:
        found = json.loads(cell)
    except (ValueError, TypeError, RecursionError) as error:
        raise DamagedCell(f"{what}: got {shown(cell)}; JSON is expected") from error
    checked(found, holds, what)
    return found


def checked(found: Any, holds: TypeAdapter, what: str) -> None:
    """Raise unless data are of a kind.

    Raises:
        DamagedCell: with the field, the value and what is expected.
    """
    try:
        holds.validate_python(found, strict=True)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = ".".join(map(str, (what, *fault["loc"])))
        raise DamagedCell(f"{where}: got {shown(fault['input'])}; {fault['msg']}") from error
