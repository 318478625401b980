"""cantools reads the DBC too, in a process of its own; what it reads otherwise is reported."""
