"""The GNSS receiver, truth side: antennas, link budget, tracking loops and channels, and the satellites that it tracks.

Read `receiver.py` first (the card), then `visibility.py`.
"""
