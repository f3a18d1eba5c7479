"""Results of a campaign as tables: their dictionary, metrics, verdicts, comparison.

Read `metric.py` first, then `registry.py`.
"""
