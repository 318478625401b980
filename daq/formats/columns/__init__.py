"""Reads columns of numbers from files of other tools, for data that are already decoded."""
