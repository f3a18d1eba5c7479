"""The command line: one command, one call of `api`, one table. Read `run.py` first."""

# blas comes first, before numpy is imported; each of the others adds its commands to the application
from lvnav_trade.cli import blas, clusters, designs, exports, logs, results, run, search
from lvnav_trade.cli.console import app, main

__all__ = ["app", "blas", "clusters", "designs", "exports", "logs", "main", "results", "run", "search"]
