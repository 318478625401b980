"""Frames from the wire: sources in blocks, whatever the interface; and back onto it."""
