"""Common functions of the metrics: selection from the tables, values of a case, intervals and probabilities.

Read `select.py` first.
"""
