"""Writes plain data as YAML that `reader` reads back to the same data."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from workbench.yaml_strict.scalars import meaning


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    # PyYAML quotes what YAML 1.1 would misread; what only the 1.2 reader takes for a number is quoted here.
    style = None if isinstance(meaning(value), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)


def _row(dumper: yaml.SafeDumper, values: tuple[object, ...]) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(str, _text)
_Dumper.add_representer(tuple, _row)


def dumps(data: Mapping[str, object]) -> str:
    """YAML text, keys in the order given, one key a line; a tuple in one line."""
    return str(yaml.dump(data, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=10_000))
