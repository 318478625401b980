"""Derives sessions from recorded frames."""
