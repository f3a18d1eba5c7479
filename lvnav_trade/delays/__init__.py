"""Atmospheric delays for truth and filter alike: models as cards, and their values on arrays.

`world` takes an `AtmosphereCard` for what is true, the filter's side a `CorrectionsCard` for its corrections; neither
knows the other's (decision 0013). Read `cards.py` first, then `models.py`.
"""
