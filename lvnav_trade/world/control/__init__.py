"""The controlled launch vehicle: what it meets along its ascent, its closed loop, and an ascent flown under it.

`ascent.py` puts an ascent in the terms of body, controller and wind; their cards are in `world/control_cards.py`.
`axis.py` holds the formulas of one axis, `loop.py` the closed loop of one run, `missions.py` many runs on keyed draws;
`flown.py` makes a trajectory of one of them. Read `ascent.py` first.
"""
