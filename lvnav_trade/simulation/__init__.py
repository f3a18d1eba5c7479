"""Monte Carlo: preparation of a case, the flight loop, blocks of runs and their statistics.

Read `flight_loop.py` first (the loop over epochs), then `montecarlo.py` (blocks of runs).
"""
