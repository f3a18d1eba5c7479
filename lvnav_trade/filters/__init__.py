"""What is believed: states, rows and correction policy of the navigation filters."""
