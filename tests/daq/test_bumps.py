"""The table of the kinds of bump, and which struck wheels count as which kind."""

from __future__ import annotations

import pytest

from daq.bumps import BUMPS, kinds_of
from daq.runs import Excitation
from daq.vehicle import Corner

FL, FR, RL, RR = Corner
BOUNCE, PITCH, ROLL, WARP, REAR = Excitation
USUAL = (BOUNCE, PITCH, ROLL)


def test_every_kind_has_a_row_in_the_order_of_the_kinds() -> None:
    assert tuple(BUMPS) == tuple(Excitation)
    assert Excitation("rear_pitch").words == "rear pitch"


@pytest.mark.parametrize(
    ("wheels", "planned", "kinds"),
    [
        ({FL, FR, RL, RR}, USUAL, (BOUNCE,)),
        ({FL, FR}, USUAL, (PITCH,)),
        # Without rear pitch in the campaign a pitch at either axle will do ..
        ({RL, RR}, USUAL, (PITCH, REAR)),
        # .. with it the axles are two kinds, and without pitch the same holds the other way.
        ({RL, RR}, (*USUAL, REAR), (REAR,)),
        ({FL, FR}, (*USUAL, REAR), (PITCH,)),
        ({FL, FR}, (BOUNCE, REAR, ROLL), (PITCH, REAR)),
        ({FL, RL}, USUAL, (ROLL,)),
        ({FR, RR}, USUAL, (ROLL,)),
        ({FR, RL}, USUAL, (WARP,)),
        ({FL, RR}, (*USUAL, WARP), (WARP,)),
        ({FL}, USUAL, ()),
        ({FL, FR, RL}, (*USUAL, REAR), ()),
    ],
)
def test_struck_wheels_make_a_kind(
    wheels: set[Corner], planned: tuple[Excitation, ...], kinds: tuple[Excitation, ...]
) -> None:
    assert kinds_of(frozenset(wheels), planned) == kinds
