"""Reference from Python: fields of a campaign, its JSON Schema, cards, metrics."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lvnav_trade.api.types import MetricNames
from lvnav_trade.quantities.errors import InputError

if TYPE_CHECKING:
    from lvnav_trade.campaign.reading.field_reference import SettingsEntry
    from lvnav_trade.campaign.syntax.card_lookup import CardInfo


def fields(path: str = "") -> list[SettingsEntry]:
    """List the fields at a path of a campaign: default, type, meaning.

    Parameters
    ----------
    path : str
        Dotted path, such as ``filter`` or ``receiver.clock``; the whole campaign if empty.

    Returns
    -------
    list of SettingsEntry
        One entry for every kind of settings at the path: kind, title, rows (field, type, default, meaning).

    Raises
    ------
    InputError
        A step of the path is unknown.
    """
    from lvnav_trade.campaign.reading.field_reference import reference

    return reference(path)


def schema() -> dict[str, Any]:
    """Return the JSON Schema of campaign files, for editors.

    Returns
    -------
    dict
        The schema, for `json.dumps`.
    """
    from lvnav_trade.campaign.reading.field_reference import json_schema

    return json_schema()


def cards(folder: str = "") -> list[CardInfo]:
    """List the cards that a campaign can use: the cards of the tool and of the working folder.

    Parameters
    ----------
    folder : str
        Folder of cards to list, such as ``imu``; all cards if empty.

    Returns
    -------
    list of CardInfo
        Name, title, source of the numbers, file.

    Raises
    ------
    InputError
        There is no card in a folder of that name.
    """
    from lvnav_trade.campaign.syntax import card_lookup
    from lvnav_trade.campaign.syntax.tree import hint

    prefix = f"{folder.rstrip('/')}/" if folder else ""
    selected_cards = card_lookup.catalogue(Path.cwd(), prefix)
    if not selected_cards:
        names = card_lookup.Shelf.from_folder(Path.cwd()).card_names()
        folders = sorted({name.partition("/")[0] for name in names})
        raise InputError(f"cards: no folder {folder!r}{hint(folder, folders)}")
    return selected_cards


def card_text(name: str) -> str:
    """Return the text of a card.

    Parameters
    ----------
    name : str
        Name or path of the card, such as ``imu/tactical_fog``.

    Returns
    -------
    str
        YAML, with its comments.

    Raises
    ------
    InputError
        There is no such card.
    """
    from lvnav_trade.campaign.syntax import card_lookup

    return card_lookup.card_text(name, Path.cwd())


def metrics(name: str = "") -> MetricNames:
    """List the metrics that a campaign can name, and the tables that are computed from results.

    Parameters
    ----------
    name : str
        Text that the name of a metric or table has to contain; all are listed if empty.

    Returns
    -------
    MetricNames
        Metrics with unit and meaning; tables with their content.

    Raises
    ------
    InputError
        No metric or table has such a name.
    """
    import pandas as pd

    from lvnav_trade.campaign.definition.metric_names import known_metrics
    from lvnav_trade.campaign.syntax.tree import hint
    from lvnav_trade.results.evaluation import METRICS

    matching_metrics = [entry for entry in known_metrics() if name in entry.metric]
    tables = {}
    for table_name, table in METRICS.items():
        if name in table_name:
            tables[table_name] = (table.__doc__ or "").partition("\n")[0]
    if not matching_metrics and not tables:
        names = [*(entry.metric for entry in known_metrics()), *METRICS]
        raise InputError(f"metrics: no metric contains {name!r}{hint(name, names)}")
    return MetricNames(pd.DataFrame(matching_metrics, columns=["metric", "unit", "meaning", "named_by"]), tables)
