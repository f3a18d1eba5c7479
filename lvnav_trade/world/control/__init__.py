"""The controlled launch vehicle: cards of body, controller and wind, and the nominal ascent in their terms.

Read `ascent.py` first.
"""
