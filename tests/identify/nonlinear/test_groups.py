"""The elements that a bench may force or forbid are those that the fit knows."""

from daq.bench.bench_tables import StructureTable
from daq.vehicle import ELEMENTS
from identify.nonlinear.groups import GROUPS, STAGES


def test_bench_file_vehicle_and_fit_know_the_same_elements() -> None:
    names = {group.name for group in GROUPS}
    assert names == set(ELEMENTS)
    assert names == set(StructureTable.model_fields) - {"symmetric"}
    released = {name for stage in STAGES for name in stage}
    assert released | {"damper_mounts"} == names


def test_an_element_that_is_not_stated_is_left_to_the_data() -> None:
    assert StructureTable().decided == {}
    stated = StructureTable(friction=False, anti_roll_bars=True)
    assert stated.decided == {"anti_roll_bars": True, "friction": False}
