"""Studies of a publication: its statements as expressions of metrics, evaluated with `lvnav_trade.api`.

A study's folder has a script `study.py` that makes a `Publication`, and a folder `statements` with a file for each
campaign. The package `lvnav_trade` knows nothing of either. Read `script.py` first.
"""

from lvnav_studies.script import Publication, main

__all__ = ["Publication", "main"]
