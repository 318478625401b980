"""The bench as a person describes it: bench.toml."""
