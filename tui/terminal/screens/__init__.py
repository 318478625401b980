"""Screens of the operator's terminal."""
