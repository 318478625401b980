"""Names channels that are frozen while the vehicle moves."""

from __future__ import annotations

from collections.abc import Sequence

from daq.samples.hold import FROZEN_S
from dbc.finding import Finding, Severity

from ..decays.decay import Record
from ..decays.stuck import frozen
from .format import listed


def stuck_findings(records: Sequence[Record]) -> tuple[Finding, ...]:
    """Find channels that do not move in the decays that are fitted."""
    found = frozen(records)
    if not found:
        return ()
    places = listed(f"{hold.channel} in {hold.run}" for hold in found)
    text = (
        f"holds one value for {found[0].longest.held_s:.2f} s (limit {FROZEN_S:g}) while the "
        f"vehicle moves: {places}; these samples are not measured and bias the result: check the "
        "sensor and repeat the run"
    )
    return (Finding("stuck_channels", Severity.WARNING, text),)
