"""Solutions of a receiver: carrier smoothing, point solution, its own filter. They never see the truth."""
