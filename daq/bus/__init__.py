"""Reads frames from any interface in blocks, and sends frames."""
