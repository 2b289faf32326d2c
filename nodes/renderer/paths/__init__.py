"""Light over several surfaces, by paths."""
