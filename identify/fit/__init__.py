"""Maximum likelihood on the free decays."""
