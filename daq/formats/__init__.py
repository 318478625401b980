"""Reads and writes logs and files of other tools, one module for each format."""
