"""Plays recorded frames, onto a bus or as a source."""
