from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from daq.arrays import session_from_arrays
from daq.channels import Channel, Quantity
from daq.errors import InputError
from daq.vehicle import BodyWeight, Corner, HubWeight, Vehicle

T = np.arange(10) / 100.0
RUN = {"z_s": (T, np.sin(T)), "theta": (T, np.cos(T))}


def test_channels_of_one_clock_share_a_group() -> None:
    runs = [("baseline", "bounce", {**RUN, "z_uA": (T + 0.001, T)})]
    session = session_from_arrays(runs)
    assert [list(group.values) for group in session.runs[0].groups] == [["z_s", "theta"], ["z_uA"]]
    np.testing.assert_array_equal(session.runs[0].groups[1].time_s, T + 0.001)
    assert [channel.name for channel in session.channels] == ["z_s", "theta", "z_uA"]


def test_repeats_are_counted() -> None:
    session = session_from_arrays(
        [("baseline", "bounce", RUN), ("added", "bounce", RUN), ("baseline", "bounce", RUN)]
    )
    assert [run.label for run in session.runs] == [
        "baseline_bounce_1",
        "added_bounce_1",
        "baseline_bounce_2",
    ]


@pytest.mark.parametrize("as_matrix", [True, False])
def test_added_mass_as_matrix_or_diagonal(as_matrix: bool) -> None:
    diagonal = [130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]
    given = np.diag(diagonal) if as_matrix else diagonal
    session = session_from_arrays([("added", "roll", RUN)], delta_mass=given)
    np.testing.assert_array_equal(session.mass_states[1].added.matrix, np.diag(diagonal))


def test_added_mass_as_weights() -> None:
    weights: list[BodyWeight | HubWeight] = [
        BodyWeight(30.0, -1.0, 0.5),
        HubWeight(4.0, Corner.REAR_LEFT),
    ]
    session = session_from_arrays([("added", "roll", RUN)], delta_mass=weights)
    assert session.mass_states[1].added.weights == tuple(weights)


def test_missing_samples_are_nan() -> None:
    values = np.where(np.arange(10) == 4, np.nan, 1.0)
    session = session_from_arrays([("baseline", "roll", {"z_s": (T, values)})])
    assert session.runs[0].groups[0].quality.nonzero()[0].tolist() == [4]


def test_own_channels() -> None:
    hub = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT)
    session = session_from_arrays([("baseline", "roll", {"hub": (T, T)})], channels=[hub])
    assert session.channels == (hub,)


@pytest.mark.parametrize(
    ("run", "names"),
    [
        (("loaded", "bounce", RUN), "loaded"),
        (("baseline", "jump", RUN), "jump"),
        (("baseline", "bounce", {"speed": (T, T)}), "speed"),
        (("baseline", "bounce", {"phi": (T, T[:5])}), "phi"),
        (("baseline", "bounce", {"phi": (T[::-1], T)}), "phi"),
        (("baseline", "bounce", {"phi": (T, ["a"] * 10)}), "phi"),
        (("baseline", "bounce", {"phi": (np.where(T > 0.05, np.nan, T), T)}), "phi"),
        (("baseline", "bounce", {}), "no channel"),
        (("baseline", "bounce"), "has 2 items"),
    ],
)
def test_what_does_not_fit_is_named(
    run: Any,
    names: str,
) -> None:
    with pytest.raises(InputError, match=names) as caught:
        session_from_arrays([("baseline", "bounce", RUN), run])
    assert caught.value.where == "run 2"


@pytest.mark.parametrize("given", [np.eye(6), [1.0, 2.0], "heavy", np.full((7, 7), np.nan)])
def test_what_is_no_mass_matrix(given: ArrayLike) -> None:
    with pytest.raises(InputError, match="delta_mass"):
        session_from_arrays([("added", "roll", RUN)], delta_mass=given)


@pytest.mark.parametrize("given", [None, "vehicle", Vehicle("vehicle")])
def test_the_vehicle_may_be_a_name_or_nothing(given: Vehicle | str | None) -> None:
    session = session_from_arrays([("baseline", "roll", RUN)], vehicle=given)
    assert session.vehicle == Vehicle("vehicle")


def test_channels_of_one_name_are_refused() -> None:
    hub = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT)
    with pytest.raises(InputError, match="same name"):
        session_from_arrays([("baseline", "roll", {"hub": (T, T)})], channels=[hub, hub])
