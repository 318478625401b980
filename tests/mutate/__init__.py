"""Small faults put into the sources on purpose, to find the tests that cannot fail."""
