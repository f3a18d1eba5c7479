"""The vehicle itself: rate and acceleration estimates, and the nozzle movement that attitude control asks for.

Read `motion.py` first.
"""
