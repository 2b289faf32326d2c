"""Single pixels between the frames of a gap, where what they show changes: error falls, cost follows events."""
