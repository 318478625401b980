"""Connects the recorder to other processes: orders, status, sockets, the service manager."""
