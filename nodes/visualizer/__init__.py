"""Shows a running graph as a live web page."""
