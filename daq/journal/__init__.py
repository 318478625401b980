"""Writes and reads the journal: every frame is on the disk before it is processed further."""
