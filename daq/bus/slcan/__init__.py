"""Reads CAN adapters on a serial line in blocks."""
