"""Groups of unknowns that are released, tested and named together: the elements of a structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .car import Model


@dataclass(frozen=True, slots=True)
class Group:
    """One choice in `[vehicle.structure]`."""

    name: str
    """As in `[vehicle.structure]`."""
    kinds: tuple[str, ...]
    """Unknowns, without the axle at their end."""
    middle: bool | None = None
    """True for the damper's knee at rest, False for its other knees; None for all else."""
    positive: bool = False
    """True if a size below zero means that the element is absent."""

    def members(self, model: Model) -> tuple[str, ...]:
        """Return the names of its unknowns."""
        if self.name == "cg_offset":
            return self.kinds
        if self.middle is None:
            return tuple(f"{k}{axle}" for k in self.kinds for axle in "fr")
        return tuple(
            f"h_{axle}{j + 1}"
            for axle in "fr"
            for j, knot in enumerate(model.knots)
            if (knot == 0.0) is self.middle
        )

    def parts(self, sized: Sequence[str]) -> tuple[tuple[str, ...], ...]:
        """Return the sets of unknowns, each of which may show that the element is present.

        `sized`: its unknowns that are zero where it is absent.  Because a car may have it on one
        axle only, the sets are all unknowns, those of the front and those of the rear.  The knees
        of both axles are one set.
        """
        if self.middle is not None or self.name == "cg_offset":
            return (tuple(sized),)
        axles = (tuple(name for name in sized if name.endswith(axle)) for axle in "fr")
        return (tuple(sized), *(part for part in axles if part))


GROUPS = (
    Group("anti_roll_bars", ("k_a",)),
    Group("cg_offset", ("y_s",)),
    Group("progressive_springs", ("k_2", "k_3")),
    Group("friction", ("F_c", "d_c"), positive=True),
    Group("static_friction", ("r_c", "v_c"), positive=True),
    Group("one_sided_dampers", (), True),
    Group("damper_knees", (), False),
    Group("damper_mounts", ("s_m",), positive=True),
    Group("tyre_damping", ("c_t",), positive=True),
    Group("progressive_tyres", ("b_t",), positive=True),
    Group("friction_left_right", ("dF_c",)),
    Group("dampers_left_right", ("s_c",)),
    Group("corners_left_right", ("dk_s", "dk_t", "dm_u")),
    Group("bump_stops", ("k_b", "g_b"), positive=True),
)
BY_NAME = {group.name: group for group in GROUPS}
AS_PARAMETERS = frozenset({"anti_roll_bars", "cg_offset", "tyre_damping"})
"""Groups that are also parameters of the linear model."""

STAGES = (
    (
        "anti_roll_bars",
        "cg_offset",
        "progressive_springs",
        "friction",
        "one_sided_dampers",
        "damper_knees",
    ),
    (
        "tyre_damping",
        "progressive_tyres",
        "friction_left_right",
        "dampers_left_right",
        "corners_left_right",
    ),
    ("bump_stops",),
)
"""Order of release: large effects first, then effects that imitate them.  If all were released
together from a far start, each would fit the effects of others.  Mounts and static friction join
when their gain is large enough."""
CORRECTIONS_FROM = 1
"""Stage with which stated uncertainties (lateness, weights, places) are released: earlier they
would absorb the effects of the elements."""


def positions(model: Model, chosen: tuple[str, ...], corrections: bool) -> NDArray[np.intp]:
    """Return which unknowns are free with the chosen groups, (F,)."""
    optional = {name for group in GROUPS for name in group.members(model)}
    wanted = {name for group in chosen for name in BY_NAME[group].members(model)}
    stated = set(model.box.corrections)
    free = []
    for i, name in enumerate(model.names):
        if corrections if name in stated else name in wanted or name not in optional:
            free.append(i)
    return np.array(free, dtype=np.intp)
