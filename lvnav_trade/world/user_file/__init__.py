"""Files of the user's own: columns of numbers to a true trajectory, and recorded errors of a receiver.

Read `columns.py` first (the card), then `table.py`.
"""
