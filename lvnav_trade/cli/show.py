"""Commands that list: status, fields, schema, cards."""

import json
from pathlib import Path
from typing import Annotated

import typer

from lvnav_trade.campaign.text import table
from lvnav_trade.cli.console import Answer, verb


@verb()
def status(folder: Annotated[Path, typer.Argument(metavar="RESULTS")]) -> Answer:
    """Show the progress of a campaign: running, finished, damaged.

    Blocks and tables are checked.
    """
    from lvnav_trade.campaign.running.status import status as look

    found = look(folder)
    return Answer(found.text, found._asdict() | {"cases": [case._asdict() for case in found.cases]})


@verb()
def fields(
    path: Annotated[
        str | None, typer.Argument(metavar="PATH", help="filter, receiver.clock, faults; the whole campaign if absent")
    ] = None,
) -> Answer:
    """List the fields at a path of a campaign.

    Each with its default, what it takes and what it means; for every kind where there are several.
    """
    from lvnav_trade.campaign.reading.reference import reference

    found = reference(path or "")
    blocks = []
    for part in found:
        title = f"kind: {part.kind} - {part.title}" if part.kind else part.title
        rows = [[row.field, row.default, "; ".join(filter(None, (row.type, row.meaning)))] for row in part.rows]
        blocks.append(f"{title}\n{table(['field', 'default', 'takes'], rows)}")
    parts = [part._asdict() | {"rows": [row._asdict() for row in part.rows]} for part in found]
    return Answer("\n\n".join(blocks), {"path": path or "", "parts": parts})


@verb(with_json=False)
def schema() -> Answer:
    """Print the JSON Schema of campaign files, for editors."""
    from lvnav_trade.campaign.reading.reference import json_schema

    return Answer(json.dumps(json_schema(), indent=2))


@verb()
def cards(
    name: Annotated[str | None, typer.Argument(metavar="CARD", help="show this card, or list this folder")] = None,
) -> Answer:
    """List the cards there are, all or of a folder, or show one."""
    from lvnav_trade.campaign.syntax import cards as shelf

    every = shelf.catalogue(Path.cwd())
    found = [card for card in every if card.name.startswith(f"{(name or '').rstrip('/')}/")]
    if name is not None and not found:
        text = shelf.card_text(name, Path.cwd())
        return Answer(text.removesuffix("\n"), {"name": name, "text": text})
    found = found or every
    listed = table(["card", "what", "source"], [[card.name, card.title, card.source] for card in found])
    return Answer(listed, {"cards": [card._asdict() for card in found]})
