"""Reading of YAML files by scripts: cards with units, published numbers, input errors with file and line.

A script's card is a subclass of `Card`, and `read_input` reads a file into it. `InputFile.mistake` reports an input
error that becomes apparent only together with a campaign.
"""

from __future__ import annotations

from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from pydantic import ValidationError

from lvnav_trade.campaign.definition.metric_names import metric_of
from lvnav_trade.campaign.definition.published_cards import Case as Levels
from lvnav_trade.campaign.definition.published_cards import (
    MeasuredMetric,
    Pooled,
    PublishedNumber,
    PublishedStatement,
    require_unit,
)
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.campaign.reading.checks import (
    error_axes,
    name_suggestion,
    named_cases,
    pool_faults,
    pooled_levels,
    reference_faults,
    unknown_axis,
    unknown_case,
)
from lvnav_trade.campaign.reading.explain import explain
from lvnav_trade.campaign.syntax import tree
from lvnav_trade.campaign.syntax.tree import SourceTree, hint
from lvnav_trade.quantities import expression
from lvnav_trade.quantities.errors import InputError, Mistake, quoted, refuse_all
from lvnav_trade.quantities.input_limits import STATEMENTS
from lvnav_trade.quantities.units import Angle, Card, Duration, Length, Share, parse

__all__ = [
    "STATEMENTS",
    "Angle",
    "Campaign",
    "Card",
    "Duration",
    "InputError",
    "InputFile",
    "Length",
    "Levels",
    "MeasuredMetric",
    "Mistake",
    "Pooled",
    "PublishedNumber",
    "PublishedStatement",
    "Share",
    "error_axes",
    "expression",
    "hint",
    "metric_of",
    "name_suggestion",
    "named_cases",
    "parse",
    "pool_faults",
    "pooled_levels",
    "quoted",
    "read_input",
    "reference_faults",
    "refuse_all",
    "require_unit",
    "unknown_axis",
    "unknown_case",
]

_Model = TypeVar("_Model", bound=Card)


class InputFile(NamedTuple, Generic[_Model]):
    """A file that was read, with the places of its values.

    content : Its settings, an instance of the card's class.
    source_tree : Line and column of each setting in the file.
    """

    content: _Model
    source_tree: SourceTree

    def mistake(self, path: str, message: str) -> Mistake:
        """Return an input error of the setting at a dotted path, with its line and column."""
        return self.source_tree.mistake(path, message)


def read_input(file: str | Path, model: type[_Model]) -> InputFile[_Model]:
    """Read a YAML file as settings.

    Parameters
    ----------
    file : str or Path
        The file.
    model : type of Card
        Class of the settings.

    Returns
    -------
    InputFile
        The settings, with their lines and columns.

    Raises
    ------
    InputError
        One line per input error, with file, line and column.
    """
    root = tree.read_mapping(Path(file))
    try:
        return InputFile(model.model_validate(tree.plain_data(root)), SourceTree(root))
    except ValidationError as error:
        raise InputError(records=explain(error, root, model)) from None
