"""Scalar measurements: truth side and filter side of each observable and sensor."""
