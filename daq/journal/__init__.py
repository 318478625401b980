"""The write-ahead journal: every frame is on the disk before anything else is done with it."""
