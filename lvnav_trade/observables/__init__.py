"""Scalar measurements, truth side and model side together."""
