"""Does long work in separate processes."""
