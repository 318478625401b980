"""The table of the kinds of bump, and which struck wheels count as which kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daq.arrays import session_from_arrays
from daq.bumps import BUMPS, kinds_of
from daq.derive.from_logs import parse_runs
from daq.runs import Excitation
from daq.session import read_session, write_session
from daq.vehicle import Corner

FL, FR, RL, RR = Corner
BOUNCE, PITCH, ROLL, WARP, REAR = Excitation
USUAL = (BOUNCE, PITCH, ROLL)


def test_every_kind_has_a_row_in_the_order_of_the_kinds() -> None:
    assert tuple(BUMPS) == tuple(Excitation)
    assert Excitation("rear_pitch").words == "rear pitch"


@pytest.mark.parametrize(
    ("kind", "shares", "hand"),
    [
        (BOUNCE, (1.0, 1.0, 1.0, 1.0), (0, 0)),
        (PITCH, (1.0, 1.0, 0.0, 0.0), (1, 0)),
        (ROLL, (1.0, 0.0, 1.0, 0.0), (0, 1)),
        (WARP, (1.0, 0.0, 0.0, 1.0), None),
        (REAR, (0.0, 0.0, 1.0, 1.0), (-1, 0)),
    ],
)
def test_a_kind_lifts_its_wheels_and_a_hand_pushes_where_they_are(
    kind: Excitation, shares: tuple[float, ...], hand: tuple[int, int] | None
) -> None:
    """Left is positive, as is ahead; no hand pushes two opposite corners."""
    assert (BUMPS[kind].shares, BUMPS[kind].hand) == (shares, hand)


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


def test_a_rear_pitch_keeps_its_name_from_import_to_session(tmp_path: Path) -> None:
    first, second = parse_runs("baseline:rear_pitch, baseline:rear_pitch")
    assert (first.label, second.label) == ("baseline_rear_pitch_1", "baseline_rear_pitch_2")
    time_s = np.arange(10) / 100.0
    runs = [("baseline", "rear_pitch", {"z_s": (time_s, time_s)})]
    write_session(tmp_path / "car.h5", session_from_arrays(runs))
    (run,) = read_session(tmp_path / "car.h5").runs
    assert (run.excitation, run.label) == (Excitation.REAR_PITCH, "baseline_rear_pitch_1")
