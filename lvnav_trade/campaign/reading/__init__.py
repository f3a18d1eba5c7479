"""From files to a checked campaign or study: cards, overrides, sets, checks, input errors. Read `load.py` first."""
