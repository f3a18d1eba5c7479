"""The command line: verbs only; one verb, one call, one table."""

from lvnav_trade.cli import carry_out, design, look_up, study, tell  # each puts its verbs into the application
from lvnav_trade.cli.console import app, main

__all__ = ["app", "carry_out", "design", "look_up", "main", "study", "tell"]
