"""Scalar measurements, truth side and belief side together."""
