"""Recorded frames played again, onto a bus or as a source."""
