"""Reads a foreign session file in a separate process with limits.

Bit flips are enough to make libhdf5 crash or hang, and crafted files do worse.  The child has a
bounded address space and time, may not write files and loads no filter plugins; it returns plain
data (`wire`).
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Timer

from ...errors import InputError
from ..schema import max_total_bytes
from ..tree import Group, Part
from .wire import receive

_BUSY_ADVICE = "the drive does not answer or the machine is busy; try again"
_PATIENCE = 6
"""Ratio of the child's wall-clock limit to its CPU limit, because machines have other work."""
_BYTES_PER_S = 4 << 20
"""Least rate at which a packed file is read, bytes/s: a tenth of the measured rate."""


@dataclass(frozen=True, slots=True)
class Reader:
    """A module that reads one kind of file in a child process."""

    module: str
    """Name of the module, run as ``python -I -m MODULE FILE MAX_BYTES MAX_S ...``; it sends a tree
    or an error."""
    name: str
    """Library that may crash, for messages."""
    child_bytes: int
    """Address space of the child in addition to the unpacked size of the file, bytes."""
    child_s: int
    """Time of the child for starting and for a small file, s."""
    advice: str
    """Advice if the file cannot be read."""


_SESSIONS = Reader(
    "daq.session.sandbox",
    "HDF5",
    768 << 20,  # Python, NumPy and libhdf5
    10,  # they start in half a second here, and in ten times as long on a small computer
    "the file is damaged or hostile; build it again from its journal",
)


def load_guarded(path: Path | str, part: Part = Part.WHOLE) -> Group:
    """Read a session file in a child process with limits; as `load.load_tree`.

    Raises InputError if it is not a session, and if reading it crashes, takes too long or needs too
    much memory.
    """
    size = Path(path).stat().st_size if Path(path).is_file() else 0
    return read_guarded(_SESSIONS, str(path), (part,), size, max_total_bytes(size))


def read_guarded(
    reader: Reader, where: str, arguments: Sequence[str], file_bytes: int, limit_bytes: int
) -> Group:
    """Return the tree that a child with limits reads from a file.

    `where`: the file.  `arguments`: arguments after the file and the limits.  `limit_bytes`:
    largest size of the arrays.  Raises InputError as `load_guarded`.
    """
    limit_s = reader.child_s + file_bytes // _BYTES_PER_S
    command = [sys.executable, "-I", "-m", reader.module, where]
    command += [str(reader.child_bytes + limit_bytes), str(limit_s), *arguments]
    # One thread: each BLAS thread would take address space, and nothing is computed here.
    environment = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "HDF5_PLUGIN_PRELOAD": "::"}
    try:
        started = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | environment,
        )
    except OSError as error:
        what = f"cannot be read: no process to read it in ({error.strerror or error})"
        raise InputError(where, what, "end other programs, and try again") from error
    with started as child:
        assert child.stdout is not None
        # The CPU limit does not end a child that waits, without end or for a busy machine.
        late = Event()

        def end() -> None:
            late.set()
            child.kill()

        watch = Timer(_PATIENCE * limit_s, end)
        watch.start()
        try:
            return receive(child.stdout, limit_bytes)
        except InputError:
            raise
        except (ValueError, LookupError, TypeError, MemoryError) as error:
            child.stdout.close()
            code = child.wait()
            if late.is_set():  # not the fault of the file: the child had processor time left
                what = f"cannot be read: no answer for {_PATIENCE * limit_s:.0f} s"
                raise InputError(where, what, _BUSY_ADVICE) from error
            raise InputError(where, _what_happened(code, reader.name), reader.advice) from error
        finally:
            watch.cancel()
            child.kill()


def _what_happened(code: int, library: str) -> str:
    """Return in words how the child ended."""
    name = signal.Signals(-code).name if code < 0 else ""
    if name in ("SIGXCPU", "SIGKILL"):
        return "cannot be read: it takes too long"
    if name:
        return f"cannot be read: {library} crashes on it ({name})"
    return "cannot be read: reading stopped early"
