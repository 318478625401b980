"""A simulated car on a simulated bench: written from forces, an independent truth."""
