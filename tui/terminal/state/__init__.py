"""Pure functions from the recorder's status to the contents of the screens."""
