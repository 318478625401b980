"""The damper's mount: a compliance in series with the damper.

Parameter: sigma = 1/k_m [m/N]; 0 is rigid.  State: the mount's deflection e [m].  A small loss of
the rubber, t0 [s], makes the form regular: ``sigma D(r) + t0 r = e + t0 w`` gives the speed r in
the damper, which is w exactly where sigma is 0, and no term is stiff for any sigma >= 0.
"""

from __future__ import annotations

from .hinge import Value


def mount_misfit(r: Value, force: Value, e: Value, w: Value, sigma: Value, loss_s: Value) -> Value:
    """Return the residual of the mount's equation at the speed r, m; `force` is the damper's."""
    return sigma * force + loss_s * r - e - loss_s * w


def mount_slope(damping: Value, sigma: Value, loss_s: Value) -> Value:
    """Return the derivative of `mount_misfit` by r, s; `damping` is the slope of the force."""
    return sigma * damping + loss_s
