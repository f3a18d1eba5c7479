"""The vehicle under attitude control, run by run, beside the navigation filter: how its nozzle moves and it turns.

`nozzle.py` gives the results of a case; the closed loop is in `world/guided`.
"""
