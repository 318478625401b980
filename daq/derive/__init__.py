"""Sessions derived from recorded frames."""
