"""Reads foreign session files in a process with limits."""
