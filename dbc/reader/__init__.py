"""Database files read into layouts: DBC by our own grammar, KCD and SYM by cantools."""
