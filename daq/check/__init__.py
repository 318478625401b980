"""The bench check, and the proposal of a bench from what is on the bus."""
