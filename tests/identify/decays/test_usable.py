"""Which runs and channels of a session can be used, on sessions made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq import session_from_arrays
from daq.channels import Channel, Quantity
from daq.runs import RunStatus
from daq.sessions import Session
from identify.decays.usable import usable, usable_session

Array = NDArray[np.float64]
_time = np.arange(300) / 100.0
BUMP_S = 0.2


def moving(seed: int = 0, at_s: float = 1.0) -> Array:
    """Return noise of 1 with a bump of 100 and its decay."""
    since = np.maximum(_time - at_s, 0.0)
    swing = 100.0 * np.sin(9.0 * since) * np.exp(-since) * (at_s < _time)
    return np.asarray(swing + np.random.default_rng(seed).standard_normal(len(_time)))


def session(*runs: dict[str, tuple[Array, Array]]) -> Session:
    channels = [Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "abc"]
    given = [("baseline", "bounce", records) for records in runs]
    return session_from_arrays(given, channels, bump_s=BUMP_S)


def sent(keep: NDArray[np.bool_], seed: int = 0) -> tuple[Array, Array]:
    return _time[keep], moving(seed)[keep]


WHOLE = np.ones(len(_time), bool)
GOOD = {"a": sent(WHOLE, 1), "b": sent(WHOLE, 2)}


def reasons(given: Session) -> list[str]:
    used = usable_session(given)
    for run in used.runs:
        assert (run.status is RunStatus.REJECTED) == bool(run.reasons)
    return ["; ".join(run.reasons) for run in used.runs]


@pytest.mark.parametrize(
    ("begin_s", "end_s", "reason"),
    [
        (1.2, 9.0, "b sent nothing from 1.20 to 2.99 s (limit 0.25 s)"),  # loose on the bump
        (1.5, 1.73, ""),
        (1.5, 1.76, "b sent nothing from 1.50 to 1.77 s (limit 0.25 s)"),  # came back
        (-1.0, 0.24, ""),
        (-1.0, 0.26, "b sent nothing from 0.00 to 0.27 s (limit 0.25 s)"),  # came late
        (2.75, 9.0, ""),
        (2.73, 9.0, "b sent nothing from 2.73 to 2.99 s (limit 0.25 s)"),
    ],
)
def test_a_run_in_which_a_sensor_falls_silent_is_left_out(
    begin_s: float, end_s: float, reason: str
) -> None:
    heard = (begin_s + 0.001 > _time) | (end_s < _time)
    assert reasons(session(GOOD, {"a": sent(WHOLE), "b": sent(heard)}, GOOD)) == ["", reason, ""]


@pytest.mark.parametrize(("silent", "usual"), [(2, False), (3, True)])
def test_what_is_silent_in_most_runs_was_recorded_so(silent: int, usual: bool) -> None:
    short = {"a": sent(WHOLE), "b": sent(_time < 2.005)}
    given = session(*[short] * silent, *[GOOD] * (4 - silent))
    assert [bool(reason) for reason in reasons(given)[:silent]] == [not usual] * silent
    assert usable(given).silent == (("b",) if usual else ())


def test_a_time_in_which_no_sensor_sends_is_a_jump_of_the_clock_in_however_many_runs() -> None:
    jumped = {name: sent((_time < 1.505) | (_time > 1.905), seed) for seed, name in enumerate("ab")}
    reason = "all sensors sent nothing from 1.50 to 1.91 s (limit 0.25 s)"
    given = session(jumped, jumped, GOOD)
    assert reasons(given) == [reason, reason, ""]
    assert usable(given).silent == ()


def test_a_clock_that_goes_back_costs_its_run() -> None:
    given = session(GOOD, GOOD)
    run = given.runs[1]
    (group,) = run.groups
    assert group.name == "a"
    for swapped, reason in (([150, 150], ""), ([151, 150], "the times of a go back after 1.51 s")):
        time_s = group.time_s.copy()
        time_s[[150, 151]] = group.time_s[swapped]
        spoilt = replace(run, groups=(replace(group, time_s=time_s),))
        assert reasons(replace(given, runs=(given.runs[0], spoilt))) == ["", reason]


def test_slow_sensors_together_have_their_own_limit() -> None:
    """At 10 samples a second, ten cycles are a second."""
    for gap_s, left in ((0.85, False), (1.15, True)):
        heard = (np.arange(len(_time)) % 10 == 0) & ~((_time > 1.45) & (_time < 1.45 + gap_s))
        slow = {name: sent(heard, seed) for seed, name in enumerate("ab")}
        assert any("sent nothing" in reason for reason in reasons(session(slow))) is left


def test_a_channel_that_is_not_in_a_run_leaves_the_run() -> None:
    nothing = (_time, np.full(len(_time), np.nan))
    assert reasons(session(GOOD, {"a": sent(WHOLE)}, {"a": sent(WHOLE), "b": nothing})) == [""] * 3


def test_rejected_runs_and_unused_channels_do_not_count() -> None:
    loose = {"a": sent(WHOLE), "b": sent(_time < 1.205)}
    given = session(GOOD, loose, GOOD)
    unused = [replace(c, quantity=Quantity.UNUSED) if c.name == "b" else c for c in given.channels]
    assert reasons(replace(given, channels=tuple(unused))) == [""] * 3
    dropped = replace(given.runs[1], status=RunStatus.REJECTED, reasons=("by hand",))
    given = replace(given, runs=(given.runs[0], dropped, given.runs[2]))
    assert reasons(given) == ["", "by hand", ""]
    assert usable_session(given) == given


def test_a_run_without_motion_is_left_out() -> None:
    rest, still = _time[:90], np.full(90, 9.81)
    given = session(
        GOOD,
        {"a": (rest, moving()[:90]), "b": (rest, moving(1)[:90])},
        {"a": (rest, still), "b": (rest, still)},
    )
    assert reasons(given) == ["", "nothing moves in it", "nothing moves in it"]


@pytest.mark.parametrize(
    ("length_s", "reason"),
    [
        (1.15, "it ends 0.00 s after the bump: record longer (at least 0.20 s)"),
        (1.43, "it ends 0.18 s after"),
        (1.46, ""),
    ],
)
def test_a_run_that_ends_with_its_bump_is_left_out(length_s: float, reason: str) -> None:
    """The motion is seen at 1.03 s, and the decay begins 0.21 s later."""
    short = {name: sent(length_s > _time, seed) for seed, name in enumerate("ab")}
    (found,) = reasons(session(short))
    assert (reason in found) if reason else not found


def test_a_channel_of_one_value_in_all_runs_is_unused() -> None:
    def held(value: float) -> dict[str, tuple[Array, Array]]:
        return {**GOOD, "c": (_time, np.full(len(_time), value))}

    def unused(given: Session) -> list[str]:
        return [c.name for c in usable_session(given).channels if c.quantity is Quantity.UNUSED]

    assert unused(session(held(3.0), held(4.0))) == ["c"]
    assert unused(session(held(3.0), {**GOOD, "c": sent(WHOLE)})) == []
    assert unused(session(GOOD)) == []
