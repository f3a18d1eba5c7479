"""How a filter behaves: consistency of its covariance, whiteness of innovations, observability, mode logic.

Read `consistency.py` first.
"""
