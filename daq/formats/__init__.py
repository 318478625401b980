"""Logs and files of other tools, one format a file."""
