"""Detection, isolation and recovery of faults by the filter.

Read `assess.py` first; the card is in `filter/policies/policy_cards.py`.
"""
