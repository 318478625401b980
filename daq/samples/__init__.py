"""From frames to samples in SI on the sensors' own clocks, and to runs."""
