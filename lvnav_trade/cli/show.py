"""Commands that list: status, fields, schema, cards."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import Debug, Json, app, errors, say


@app.command()
def status(
    folder: Annotated[Path, typer.Argument(metavar="RESULTS")], as_json: Json = False, debug: Debug = False
) -> None:
    """Show the progress of a campaign: running, finished, damaged.

    Blocks and tables are checked.
    """
    with errors(as_json, debug):
        from lvnav_trade.campaign.running.status import status as look

        found = look(folder)
        say("status", as_json, found.text, **found._asdict() | {"cases": [case._asdict() for case in found.cases]})


@app.command()
def fields(
    path: Annotated[
        str | None, typer.Argument(metavar="PATH", help="filter, receiver.clock, faults; the whole campaign if absent")
    ] = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """List the fields at a path of a campaign.

    Each with its default, what it takes and what it means; for every kind where there are several.
    """
    with errors(as_json, debug):
        from lvnav_trade.campaign.reading.reference import reference

        found = reference(path or "")
        blocks = []
        for part in found:
            title = f"kind: {part.kind} - {part.title}" if part.kind else part.title
            rows = [[row.field, row.default, "; ".join(filter(None, (row.type, row.meaning)))] for row in part.rows]
            blocks.append(f"{title}\n{table(['field', 'default', 'takes'], rows)}")
        content = [part._asdict() | {"rows": [row._asdict() for row in part.rows]} for part in found]
        say("fields", as_json, "\n\n".join(blocks), path=path or "", parts=content)


@app.command()
def schema(debug: Debug = False) -> None:
    """Print the JSON Schema of campaign files, for editors."""
    with errors(False, debug):
        from lvnav_trade.campaign.reading.jsonschema import json_schema

        print(json.dumps(json_schema(), indent=2))


@app.command()
def cards(
    name: Annotated[str | None, typer.Argument(metavar="CARD", help="show this card, or list this folder")] = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """List the cards there are, all or of a folder, or show one."""
    with errors(as_json, debug):
        from lvnav_trade.campaign.syntax import cards as shelf

        found = [card for card in shelf.catalogue(Path.cwd()) if card.name.startswith(f"{(name or '').rstrip('/')}/")]
        if name is not None and not found:
            text = shelf.card_text(name, Path.cwd())
            say("cards", as_json, text.removesuffix("\n"), name=name, text=text)
            return
        found = found or shelf.catalogue(Path.cwd())
        listed = table(["card", "what", "source"], [[card.name, card.title, card.source] for card in found])
        say("cards", as_json, listed, cards=[card._asdict() for card in found])
