"""Provenance for the manifest: the request, without folders and the name of the machine unless these are wanted."""

import os
import platform
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.quantities.errors import without_credentials

# Environment variable: if it has a value, the manifest contains the name of the machine and absolute paths
RECORD_HOST = "LVNAV_TRADE_RECORD_HOST"
_PATH = re.compile(
    r"[\w+.-]+://[^\s'\"]*|(?<![^\s='\"(\[{,:])(?:/|~[\w.-]*/|[A-Za-z]:\\)[^\s'\",;:)\]}]*"
)  # an address, which is not changed, or an absolute path


def manifest(campaign: Campaign, requested_cases: Sequence[Case]) -> dict[str, Any]:
    """Return the part of the manifest that describes the request; the store adds the versions that computed it."""
    card = campaign.monte_carlo
    content = {
        "seed": campaign.seed,
        **command_record(),
        "asked_cases": {case.id: case.label for case in requested_cases},
        "asked_runs": card.runs if card else 0,
        "asked_block": card.block if card else 1,
    }
    if card is not None and card.selected:
        content["asked_runs_of"] = {case.id: card.runs_of(case.axes) for case in requested_cases}
    return content


def command_record() -> dict[str, Any]:
    """Return the arguments of the command line for the manifest; host and absolute paths only if they are wanted."""
    if os.environ.get(RECORD_HOST):
        return {
            "command": [without_credentials(text) for text in sys.argv[1:]],
            "host": platform.node(),
            "folder": str(Path.cwd()),
        }
    return {"command": [_argument(text) for text in sys.argv[1:]]}


def without_folders(text: str) -> str:
    """Return a text with absolute paths shortened to the file name, unless folders are wanted.

    Addresses remain, without credentials.
    """
    text = without_credentials(text)
    if os.environ.get(RECORD_HOST):
        return text
    return _PATH.sub(_shortened_path, text)


def _shortened_path(match: re.Match[str]) -> str:
    is_address = "://" in match[0]
    return match[0] if is_address else _file_name(match[0])


def _argument(text: str) -> str:
    """Return an argument with absolute paths shortened, as in ``--out=/a/b`` or ``almanac=/a/b``, also with spaces."""
    text = without_credentials(text)
    name, equals, value = text.partition("=")
    if name.startswith("/"):
        return _file_name(text)
    if equals and value.startswith("/"):
        return f"{name}={_file_name(value)}"
    return without_folders(text)


def _file_name(path: str) -> str:
    return re.split(r"[/\\]", path.rstrip("/\\"))[-1]
