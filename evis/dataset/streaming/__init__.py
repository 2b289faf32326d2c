"""Simulates data sets without files, while they are used."""
