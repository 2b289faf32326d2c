"""The event sensor: against closed forms, beside other simulators, on a CPU and on a GPU."""
