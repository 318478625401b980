"""Reads SocketCAN in blocks."""
