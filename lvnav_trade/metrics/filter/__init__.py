"""How a filter behaves: consistency, whiteness of innovations, mode logic. Read `consistency.py` first."""
