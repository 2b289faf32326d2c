"""Reads frames, and draws pictures and animations."""
