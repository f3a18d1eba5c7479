"""YAML trees with positions, lookup of cards, fields of the settings models. Read `tree.py` first."""
