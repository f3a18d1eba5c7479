"""The ground floor: jitted formulas of floats, of float64 arrays, or of lanes of eight runs."""
