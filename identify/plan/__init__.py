"""The planner: the intervals that a campaign will give, from the Fisher information.

`outlook(plan)` gives the expected interval of every parameter, `advise(plan)` also the best next
steps: run, bump, rate, sensor, weight, fact; `compare_campaigns(plan)` those of other campaigns.
"""
