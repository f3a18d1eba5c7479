"""Scenario of a case, the rules between its settings, and the filter models that follow from it."""
