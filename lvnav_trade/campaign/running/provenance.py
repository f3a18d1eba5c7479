"""Provenance for the manifest: the request, without folders and machine name unless these are wanted."""

import os
import platform
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign
from lvnav_trade.errors import without_credentials

# Environment variable: with a value, the manifest keeps the name of the machine and absolute paths
RECORD_HOST = "LVNAV_TRADE_RECORD_HOST"
_PATH = re.compile(
    r"[\w+.-]+://[^\s'\"]*|(?<![^\s='\"(\[{,:])(?:/|~[\w.-]*/|[A-Za-z]:\\)[^\s'\",;:)\]}]*"
)  # an address, which stays as it is, or an absolute path


def manifest(campaign: Campaign, asked: Sequence[Case]) -> dict[str, Any]:
    """Return what the results should say of how they were asked for; the store adds what computed them."""
    runs, block = (campaign.monte_carlo.runs, campaign.monte_carlo.block) if campaign.monte_carlo else (0, 1)
    cases = {case.id: case.label for case in asked}
    found = {"seed": campaign.seed, **asked_by(), "asked_cases": cases, "asked_runs": runs, "asked_block": block}
    card = campaign.monte_carlo
    if card is None or not card.selected:
        return found
    return found | {"asked_runs_of": {case.id: card.runs_of(case.axes) for case in asked}}


def asked_by() -> dict[str, Any]:
    """Return the arguments of the command line for the manifest; the host and absolute paths where they are wanted."""
    if os.environ.get(RECORD_HOST):
        return {
            "command": [*map(without_credentials, sys.argv[1:])],
            "host": platform.node(),
            "folder": str(Path.cwd()),
        }
    return {"command": [_argument(text) for text in sys.argv[1:]]}


def without_folders(text: str) -> str:
    """Return a text with every absolute path cut to the name of its file, unless the folders are wanted; an address
    stays, without credentials.
    """
    text = without_credentials(text)
    return text if os.environ.get(RECORD_HOST) else _PATH.sub(_short, text)


def _short(found: re.Match[str]) -> str:
    return found[0] if "://" in found[0] else _name(found[0])


def _argument(text: str) -> str:
    """Return an argument with absolute paths cut, such as ``--out=/a/b`` or ``almanac=/a/b``, spaces in them too."""
    text = without_credentials(text)
    name, equals, value = text.partition("=")
    if name.startswith("/"):
        return _name(text)
    return f"{name}={_name(value)}" if equals and value.startswith("/") else without_folders(text)


def _name(path: str) -> str:
    return re.split(r"[/\\]", path.rstrip("/\\"))[-1]
