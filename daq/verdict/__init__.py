"""Judges a run immediately after its end, in plain words."""
