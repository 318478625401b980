"""Reads the description of a bench: bench.toml."""
