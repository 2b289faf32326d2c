"""Makes the sequences of a recipe: by workers that hold warm simulations, and those who give them work."""
