"""The recorder as others see it: orders, status, sockets, the service manager."""
