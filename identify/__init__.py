"""From runs to physical parameters with confidence intervals.  Pure computation."""
