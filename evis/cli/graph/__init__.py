"""Groups the commands on graphs: to start one, to look at it while it runs, to record it and to play it again."""
