"""Pure functions from the recorder's status to what the terminal shows."""
