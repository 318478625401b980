"""Free decays cut from runs."""
