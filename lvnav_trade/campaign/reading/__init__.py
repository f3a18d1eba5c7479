"""Reading of campaigns and studies: cards, overrides, sets, checks, input errors. Read `load.py` first."""
