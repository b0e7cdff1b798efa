"""`workbench schema`: JSON Schemas, so that editors complete and check the files."""

from __future__ import annotations

import json

import click


@click.command(name="schema")
@click.argument("kind", type=click.Choice(["scenario", "machine", "runs"]), default="scenario")
def command(kind: str) -> None:
    """Print the JSON Schema of a scenario file (or of machine.yaml, or of a campaign's runs.yaml).

    Editors with a YAML language server take it from the file's first line:

    \b
        workbench schema scenario > scenario.schema.json
        # yaml-language-server: $schema=scenario.schema.json
    """
    from workbench.study.scenario import json_schema

    click.echo(json.dumps(json_schema(kind), indent=1, ensure_ascii=False))
