"""The filter: card, states, model in numbers, propagation and update; it never sees the truth.

Read `card.py` first, then `model.py` and `ekf.py`.
"""
