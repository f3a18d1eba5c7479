"""Verbs that tell what there is: status, schema, cards."""

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
    """Tell where a campaign stands: running, unfinished, damaged or finished; blocks and tables are checked."""
    with errors(as_json, debug):
        from lvnav_trade.campaign.status import status as look

        found = look(folder)
        say("status", as_json, found.text, **found._asdict() | {"cases": [case._asdict() for case in found.cases]})


@app.command()
def schema(debug: Debug = False) -> None:
    """Print the JSON Schema of campaign files, for editors."""
    with errors(False, debug):
        from lvnav_trade.campaign.jsonschema import json_schema

        print(json.dumps(json_schema(), indent=2))


@app.command()
def cards(
    name: Annotated[str | None, typer.Argument(metavar="CARD", help="show this card")] = None,
    as_json: Json = False,
    debug: Debug = False,
) -> None:
    """List the cards that a campaign here can name, or show one with its comments."""
    with errors(as_json, debug):
        from lvnav_trade.campaign import cards as shelf

        if name is not None:
            text = shelf.card_text(name, Path.cwd())
            say("cards", as_json, text.removesuffix("\n"), name=name, text=text)
            return
        found = shelf.catalogue(Path.cwd())
        listed = table(["card", "what", "source"], [[card.name, card.title, card.source] for card in found])
        say("cards", as_json, listed, cards=[card._asdict() for card in found])
