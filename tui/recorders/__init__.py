"""Starts, feeds and follows recorder processes."""
