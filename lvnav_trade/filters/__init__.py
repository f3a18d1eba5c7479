"""Filter models: states, measurements and correction policy of the navigation filters."""
