"""Benchmarks: what the tool costs, beside what a user would take instead."""
