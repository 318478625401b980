"""Samples of a run, which cannot be changed afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from daq.runs import SampleGroup


def test_the_columns_of_a_group_cannot_be_changed_or_added_to() -> None:
    given = {"az": np.zeros(3)}
    group = SampleGroup("imu", np.arange(3.0), np.arange(3), given, np.zeros(3, np.uint8))
    values: Any = group.values
    with pytest.raises(TypeError, match="item assignment"):
        values["other"] = np.zeros(3)
    columns = (group.time_s, group.t_ns, group.quality, group.values["az"])
    assert not any(column.flags.writeable for column in columns)
    given["later"] = np.zeros(7)
    assert list(group.values) == ["az"]
