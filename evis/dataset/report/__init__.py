"""Reports on a data set that was made: numbers, whether it is whole, how it looks."""
