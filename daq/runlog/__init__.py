"""The log of runs: events of recording, judging, overriding and undoing, and their fold."""
