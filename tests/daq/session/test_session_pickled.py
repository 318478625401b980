"""Sessions and runs go through pickle and copy, and stay read-only."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ..small_session import small_session


@pytest.mark.parametrize(
    "anew", [lambda x: pickle.loads(pickle.dumps(x)), copy.copy, copy.deepcopy]
)
def test_a_session_is_pickled_and_copied(anew: Callable[[Any], Any]) -> None:
    session = small_session()
    again = anew(session)
    assert again.channels == session.channels
    assert [run.label for run in again.runs] == [run.label for run in session.runs]
    before, after = session.runs[0].groups[0], anew(session.runs[0]).groups[0]
    assert list(after.values) == list(before.values)
    for name, column in before.values.items():
        np.testing.assert_array_equal(after.values[name], column)
        assert not after.values[name].flags.writeable
    assert not after.time_s.flags.writeable
    with pytest.raises(TypeError):
        after.values["new"] = column
