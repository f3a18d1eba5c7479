"""Atmospheric delays for truth and filter alike: models as cards, and their values on arrays.

`world` uses an `AtmosphereCard` (truth), the filter a `CorrectionsCard`; neither has access to the other's (decision
0013). Read `cards.py` first, then `models.py`.
"""
