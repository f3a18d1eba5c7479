"""Satellites: constellation cards, almanacs, broadcast ephemerides, and positions and clocks over time.

Read `constellation.py` first, then `satellites.py`.
"""
