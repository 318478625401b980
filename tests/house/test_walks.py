"""Three walks through the code pass few files: on the way to 25, 25 and 30."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from daq.bench.config import Bench
from daq.control.messages import Arm, Until
from daq.journal.reader import recordings
from daq.session import read_session, write_session
from daq.session.build import derive
from dbc import Codec
from identify import identify

from ..daq.conftest import bench as bench
from ..daq.conftest import codec as codec
from ..daq.recorder_run import Running, Script, sources
from ..daq.recorder_run import quick as quick
from ..daq.small_campaign import blocks, bumps
from ..identify.stress import stress_session

ROOT = Path(__file__).parents[2]
PACKAGES = tuple(str(ROOT / package) + "/" for package in ("dbc", "daq", "identify", "tui"))


@contextmanager
def walked() -> Iterator[set[str]]:
    """Yield the set of files in which a function is called until the `with` ends, in any thread.

    The bodies of modules and classes, which run once at an import, do not count.
    """
    files: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGES) and code.co_flags & 2:
            files.add(str(Path(code.co_filename).relative_to(ROOT)))

    before = sys.getprofile()
    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield files
    finally:
        sys.setprofile(before)
        threading.setprofile(None)


def test_a_frame_on_its_way_to_a_session_file(quick: Bench, codec: Codec, tmp_path: Path) -> None:
    script = Script(blocks(bumps(codec, 1)))
    with walked() as files:
        with Running(quick, tmp_path, sources(script)) as running:
            running.order(Arm(Until.COMPLETE))
            running.until(lambda s: s.disk.recorded_frames == 1200)
        derive(recordings(tmp_path / "journal")[0].segments, tmp_path / "again.h5")
    assert {"daq/recorder/recorder.py", "dbc/codec.py"} <= files  # it sees both ends
    # `dbc.words` and `daq.runs` only if the session is built meanwhile.
    assert len(files) <= 31, sorted(files)


def test_a_session_on_its_way_to_parameters(tmp_path: Path) -> None:
    path = tmp_path / "car.h5"
    write_session(path, stress_session("linear", 1, 100.0, repeats=1))
    with walked() as files:
        identify(read_session(path))
    assert {"identify/pipeline.py"} <= files
    assert len(files) <= 32, sorted(files)
