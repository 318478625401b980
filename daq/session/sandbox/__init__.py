"""Foreign session files read in a process with limits."""
