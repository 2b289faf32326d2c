"""Data sets without files: what is simulated while it is used."""
