"""Detection, isolation and recovery of faults by a filter: read `card.py` first, then `assess.py`."""
