"""Evaluates the listed samples: which surface a pixel shows at an instant, and its radiance there."""
