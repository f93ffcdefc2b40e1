"""The command `schema`: JSON Schema of the files that people write."""

from __future__ import annotations

import json
import sys

import click

from workbench.cli.plain import PlainCommand

__all__ = ["schema"]


@click.command(cls=PlainCommand)
@click.argument("name", metavar="NAME", help="study, system, or a command: the table of its options in a study.")
def schema(name: str) -> int:
    """Print the JSON Schema (draft 2020-12) of a study, a system file, or a command's table in a study.

    Editors complete and check a file with it. `> study.schema.json` behind the command writes it to a file.

    Example: `workbench schema study`
    """
    from workbench.study.schema import schema as schema_of

    sys.stdout.write(json.dumps(schema_of(name), indent=2, ensure_ascii=False) + "\n")
    return 0
