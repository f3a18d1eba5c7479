"""Position and velocity solutions that a receiver hands out."""
