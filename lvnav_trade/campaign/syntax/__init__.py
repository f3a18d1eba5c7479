"""Files and places: YAML with positions, where cards are, what fields the settings have. Read `tree.py` first."""
