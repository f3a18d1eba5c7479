"""How tests call the command line: in this process."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from lvnav_trade.cli import app


def call(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))
