"""The command line: one command, one call of `api`, one table. Read `run.py` first."""

from lvnav_trade.cli import clusters, logs, results, run, search  # each adds its commands to the application
from lvnav_trade.cli.console import app, main

__all__ = ["app", "clusters", "logs", "main", "results", "run", "search"]
