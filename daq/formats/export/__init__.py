"""Exports sessions to the formats of other tools."""
