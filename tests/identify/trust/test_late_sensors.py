"""Which kind of sensors is late, and by how much, where other kinds are on time."""

import pytest

from daq.sim.car import SensorFault
from daq.vehicle import FORD_GRANADA
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.pipeline import grey_box
from identify.trust.faults import wrong_sensors
from tests.identify import stress
from tests.identify.stress import BODY, HUBS, TRAVELS, Stress, stress_session


def fitted(name: str, travels: bool) -> Estimation:
    session = stress_session(name, 1, 100.0, travels)
    records = usable(session).records
    return estimate(grey_box(session, records), records, [FORD_GRANADA.to_array()])


@pytest.mark.parametrize("travels", [False, True])
def test_hubs_5_ms_late_are_sized_5_ms_with_travels_and_without(travels: bool) -> None:
    """With travels, which are on time, the mean of all sensors at the wheels was 2.5 ms."""
    *_, found = wrong_sensors(fitted("hubs_late_5ms", travels), [])
    assert found.name == "hub sensors late"
    assert 4.8 < float(found.sizes.removesuffix(" ms")) < 5.2
    assert found.explained > 0.9


@pytest.mark.parametrize(
    ("channels", "name"),
    [
        (BODY, "body sensors late"),
        (TRAVELS, "travel sensors late"),
        (HUBS + TRAVELS, "hub sensors and travel sensors late"),
    ],
)
def test_the_kinds_that_are_late_are_named(
    channels: tuple[str, ...], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = Stress("8 ms late", faults=tuple(SensorFault(c, late_s=0.008) for c in channels))
    monkeypatch.setattr(stress, "STRESSES", {"late": late})
    (found,) = (
        one for one in wrong_sensors(fitted("late", True), []) if one.name.endswith(" late")
    )
    assert found.name == name
    for size in found.sizes.split(", "):
        assert 7.6 < float(size.removesuffix(" ms").split()[-1]) < 8.4
