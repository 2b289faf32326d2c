"""From a launch file to a running graph: expression, file, planner; run directory, control, supervisor."""
