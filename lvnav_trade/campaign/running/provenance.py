"""What was asked, for the manifest: without folders and the name of the machine, unless these are wanted."""

import os
import platform
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lvnav_trade.campaign.definition.axes import Case
from lvnav_trade.campaign.definition.schema import Campaign

# Environment variable: with a value, the manifest keeps the name of the machine and absolute paths
RECORD_HOST = "LVNAV_TRADE_RECORD_HOST"
_PATH = re.compile(r"(?<![^\s='\"(\[{,:])(?:/|~[\w.-]*/|[A-Za-z]:\\)[^\s'\",;:)\]}]*")


def manifest(campaign: Campaign, asked: Sequence[Case]) -> dict[str, Any]:
    """Return what the results should say of how they were asked for; the store adds what computed them."""
    runs, block = (campaign.monte_carlo.runs, campaign.monte_carlo.block) if campaign.monte_carlo else (0, 1)
    cases = {case.id: case.label for case in asked}
    return {"seed": campaign.seed, **asked_by(), "asked_cases": cases, "asked_runs": runs, "asked_block": block}


def asked_by() -> dict[str, Any]:
    """Return the arguments of the command line for the manifest; the host and absolute paths where they are wanted."""
    if os.environ.get(RECORD_HOST):
        return {"command": sys.argv[1:], "host": platform.node(), "folder": str(Path.cwd())}
    return {"command": [_argument(text) for text in sys.argv[1:]]}


def without_folders(text: str) -> str:
    """Return a text with every absolute path cut to the name of its file, unless the folders are wanted."""
    return text if os.environ.get(RECORD_HOST) else _PATH.sub(lambda found: _name(found[0]), text)


def _argument(text: str) -> str:
    """Return an argument with absolute paths cut, such as ``--out=/a/b`` or ``almanac=/a/b``, spaces in them too."""
    name, equals, value = text.partition("=")
    if name.startswith("/"):
        return _name(text)
    return f"{name}={_name(value)}" if equals and value.startswith("/") else without_folders(text)


def _name(path: str) -> str:
    return re.split(r"[/\\]", path.rstrip("/\\"))[-1]
