"""Recorders as processes: started, fed, followed."""
