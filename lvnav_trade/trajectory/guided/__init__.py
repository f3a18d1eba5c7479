"""Ascents other than the nominal ascent: dispersed, guided by a state with navigation errors, under attitude control.

Read `guidance_plan.py` first (what guidance knows before lift-off), then `explicit.py` (the law of the last stage),
`guided_dynamics.py` (the flight of a body with commanded or lagging attitude) and `ascent_runs.py` (from draws to
achieved orbits). A body under attitude control: `course.py` (commanded attitude), `axis.py` and `loop.py` (an axis at
a tick), `turning.py` (its flight), `missions.py` (many runs) and `controlled_flight.py` (a launch as a
trajectory). `pilots.py` simulates both.
"""
