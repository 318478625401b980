"""Widgets of the operator's terminal."""
