"""The GNSS receiver, truth side: antennas, link budget, tracking loops, channels, and tracked satellites.

Read `receiver.py` first (the card), then `visibility.py`.
"""
