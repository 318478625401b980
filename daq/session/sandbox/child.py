"""Reads one session file within limits, in the child of `guard`."""

from __future__ import annotations

from typing import BinaryIO

from ...errors import InputError
from ..load import load_tree
from ..schema import DAMAGED_ADVICE
from ..tree import Part
from .wire import send_error, send_tree


def main(out: BinaryIO, path: str, max_bytes: int, max_s: int, part: Part) -> None:
    """Read part of a file within limits and send its content, or the reason of a failure."""
    limit(max_bytes, max_s)
    try:
        tree = load_tree(path, part)
    except InputError as error:
        send_error(out, error)
    except Exception as error:  # h5py raises many kinds of errors on a damaged file
        what = f"is damaged: {type(error).__name__}"
        send_error(out, InputError(path, what, DAMAGED_ADVICE))
    else:
        send_tree(out, tree)


def limit(max_bytes: int, max_s: int, max_file_bytes: int = 0) -> None:
    """Bound this process: memory, time, size of files that it writes, no core dumped."""
    try:
        import resource
    except ModuleNotFoundError:  # not on Windows; there the parent's time limit is the only one
        return
    resource.setrlimit(resource.RLIMIT_AS, (max_bytes, max_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (max_s, max_s + 1))
    resource.setrlimit(resource.RLIMIT_FSIZE, (max_file_bytes, max_file_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
