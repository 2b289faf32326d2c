"""Reads scene files with checks, and builds what each of their sections becomes."""
