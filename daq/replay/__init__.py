"""Replays recorded frames, on a bus or as a source."""
