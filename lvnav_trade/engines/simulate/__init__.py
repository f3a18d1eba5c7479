"""Monte Carlo: start with `flight.py` (the loop over epochs), then `montecarlo.py` (blocks of runs)."""
