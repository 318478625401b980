"""SocketCAN read in blocks."""
