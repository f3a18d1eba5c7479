"""Options of the filter: delay, epoch differences, open loop, mode logic, stored gains, sigma points, integrity."""
