"""From the wire to a session file."""
