"""Compiled formulas of floats, of float64 arrays, or of lanes of eight runs; the lowest layer."""
