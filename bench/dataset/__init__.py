"""What data sets cost: to make, to keep, to read."""
