"""Samples of a run, which cannot be changed afterwards, and what of a session is used."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.channels import Quantity
from daq.runs import RunStatus, SampleGroup

from .small_session import small_session


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


def test_a_session_knows_its_accepted_runs_and_its_used_channels() -> None:
    session = small_session()
    first, second, third = session.runs
    assert not session.accepted
    second = replace(second, status=RunStatus.ACCEPTED)
    session = replace(session, runs=(first, second, third))
    assert [run.is_accepted for run in session.runs] == [False, True, False]
    assert session.accepted == (second,)
    az = replace(session.channels[2], quantity=Quantity.UNUSED)
    session = replace(session, channels=(*session.channels[:2], az, session.channels[3]))
    assert [c.name for c in session.used_channels] == ["hub_fl", "hub_fr", "pitch"]
