"""Reads database files into layouts: DBC by our own grammar; KCD, SYM and ARXML by cantools."""
