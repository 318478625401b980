"""Writes the proposal of `check --propose` and `import --propose`, with the open questions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .diagnostics import say

if TYPE_CHECKING:
    from daq.check import Proposal


def write_proposal(proposal: Proposal, target: Path) -> None:
    """Write a proposal and print its questions.

    Raises InputError if the file cannot be written.
    """
    from daq.files import write_named

    write_named(target, proposal.text.encode())
    say(f"wrote {target}: read it, and fill in what is marked")
    for question in proposal.questions:
        say(f"? {question}")
