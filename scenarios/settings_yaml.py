"""Settings of any kind written out as YAML, every value of them."""

from __future__ import annotations

from io import StringIO
from typing import Any

from pydantic import BaseModel
from ruamel.yaml import YAML
from ruamel.yaml.representer import SafeRepresenter


def settings_yaml(settings: BaseModel) -> str:
    """Settings of any kind written out, as YAML that reads back to the same."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _ShortLists
    yaml.default_flow_style, yaml.width = False, 110
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # its None is a default
    text = StringIO()
    yaml.dump(settings.model_dump(mode="json"), text)
    return text.getvalue()


class _ShortLists(SafeRepresenter):
    """Writes a list of plain values on one line, and all else as a block."""

    def represent_list(self, data: list) -> Any:
        plain = not any(isinstance(item, dict | list) for item in data)
        return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=plain)


_ShortLists.add_representer(list, _ShortLists.represent_list)
