"""Computed from a case: process noise and gains as filter cards, and what a study's report shows of them.

Read `filter_cards.py` first.
"""
