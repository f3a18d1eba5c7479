"""Position and velocity solutions that a receiver outputs."""
