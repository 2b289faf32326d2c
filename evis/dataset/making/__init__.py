"""How the sequences of a recipe are made: workers that hold warm simulations, and who gives them work."""
