"""Measures the event sensor against closed forms and beside other simulators, on a CPU and on a GPU."""
