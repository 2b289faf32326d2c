"""Holds the nodes of one process, built from the plan, with their queues, publishers and subscribers."""
