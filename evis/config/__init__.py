"""Reads what a user writes: YAML with line numbers, expressions, parameters with units and ranges, and where files
lie."""
