"""The command line: one command, one call of `api`, one table. Read `run.py` first."""

from lvnav_trade.cli import design, results, run, show, study  # each adds its commands to the application
from lvnav_trade.cli.console import app, main

__all__ = ["app", "design", "main", "results", "run", "show", "study"]
