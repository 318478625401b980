"""Maximum likelihood for a car that is not linear: friction, damper curves, stops, mounts, tyres.

The states of a run are integrated over time with the laws of `laws`; their
derivatives by the unknowns are integrated along that path.  Everything that belongs to one run is
eliminated run by run, so that this room returns the same as the linear fit: a share of cost,
gradient and information for each run.
"""
