"""Satellites and receiver channels: how many satellites are tracked, outages, losses, reacquisition.

Read `satellites.py` first.
"""
