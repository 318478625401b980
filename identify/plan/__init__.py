"""The planner: the intervals that a campaign will give, from the Fisher information.

`advise` gives the expected interval of every parameter and the best next steps: run, bump, rate,
sensor, weight, fact; `compare_campaigns` gives the intervals of other campaigns.
"""
