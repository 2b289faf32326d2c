"""How wrong a simulated course is, and steps short enough to keep it right."""
