"""What is true: vehicle, flight, sky, and the errors of instruments."""
