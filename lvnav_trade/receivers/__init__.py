"""Position and velocity solutions of a receiver: point solution, Kalman filter, carrier smoothing."""
