"""Converts frames to samples in SI on the sensors' own clocks, and finds runs."""
