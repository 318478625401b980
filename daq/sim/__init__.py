"""Simulates a car on a bench, from forces, as a truth that is independent of the identification."""
