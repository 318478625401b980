"""Which session may be replaced by one that is built again."""

from dataclasses import replace
from pathlib import Path

import pytest

from daq import InputError, Session, write_session
from daq.derive.replaceable import refuse_less

from ..small_session import small_session


def of_recording(uuid: str, losses: str) -> Session:
    return replace(small_session(), provenance={"uuid": uuid, "journal_losses": losses})


def test_as_much_replaces_also_where_the_journal_is_torn_behind_it(tmp_path: Path) -> None:
    """As after a crash: the session was built when its last run ended."""
    write_session(tmp_path / "old.h5", of_recording("a", "none"))
    write_session(tmp_path / "new.h5", of_recording("a", "12 bytes torn"))
    refuse_less(tmp_path / "old.h5", tmp_path / "new.h5")
    refuse_less(tmp_path / "nothing.h5", tmp_path / "new.h5")


def test_one_frame_less_does_not_replace(tmp_path: Path) -> None:
    whole = of_recording("a", "none")
    first, *rest = whole.runs
    cut = replace(first, frames=first.frames.select(slice(1, None)))
    write_session(tmp_path / "old.h5", whole)
    write_session(tmp_path / "new.h5", replace(whole, runs=(cut, *rest)))
    with pytest.raises(InputError, match=f"has more of {first.label} than the journal now"):
        refuse_less(tmp_path / "old.h5", tmp_path / "new.h5")
    refuse_less(tmp_path / "new.h5", tmp_path / "old.h5")
    write_session(tmp_path / "other.h5", of_recording("b", "none"))
    with pytest.raises(InputError, match="of another recording"):
        refuse_less(tmp_path / "other.h5", tmp_path / "old.h5")
