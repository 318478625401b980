"""Checks a bench, and proposes a bench from the traffic on the bus."""
