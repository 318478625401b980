"""Modes from free decays: the State Variable Method and its likelihood."""
