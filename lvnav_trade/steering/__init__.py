"""The vehicle under attitude control, run by run: a simulator beside that of the navigation filter.

`nozzle.py` gives the results of a case, `missions.py` prepares and runs its missions on keyed draws, `loop.py` is the
closed loop of one mission, and `axis.py` holds the formulas of one axis. Its cards and its nominal ascent are in
`world/control`. Read `missions.py` first.
"""
