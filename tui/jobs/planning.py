"""Plans the campaign of a bench, for the car of a session or for a typical one.

The terminal starts ``python -m tui.jobs.planning``, writes one JSON object (bench.toml and the
recorder's folder) to its standard input and reads the gain by the weights back: the terminal itself
imports no SciPy and never waits.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter

from daq import BumpbenchError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from daq import Session
    from daq.bench.config import Bench
    from identify.plan.design import Plan


def planned(
    bench: Bench,
    vehicle: NDArray[np.float64],
    rate_hz: float | None,
    bump_height_m: float,
) -> Plan:
    """Return the campaign of a bench as a plan, its sensors with the usual noise of their kind.

    `bench`: sensors, weights, campaign, and the known facts of the vehicle.  `vehicle`, (15,) or
    (28,) float64: parameters that are expected.  `rate_hz`: samples a second; None: the rates of
    the DBC.
    """
    from daq import Quantity
    from daq.bench.config import bench_codec
    from daq.samples.mapping import mapped_channels
    from identify.model.response import Bump
    from identify.plan.design import Plan, Runs, sensor

    return Plan(
        vehicle=vehicle,
        sensors=tuple(
            # 5 ms where neither the DBC nor the command line has a rate.
            sensor(mapped.channel.placed(), rate_hz or 1.0 / (mapped.message.cycle_s or 0.005))
            for mapped in mapped_channels(bench, bench_codec(bench))
            if mapped.channel.quantity is not Quantity.UNUSED
        ),
        mass_states=tuple(state.weighed() for state in bench.mass_states),
        runs=tuple(
            Runs(state, excitation, bench.campaign.repeats)
            for state in bench.campaign.mass_states
            for excitation in dict.fromkeys(bench.campaign.excitations)
        ),
        bump=Bump(bump_height_m, start_s=0.0, duration_s=bench.campaign.bump_s),
        # At least 0.2 s: some triggers record hardly longer than the bump takes.
        decay_s=max(bench.trigger.post_s - bench.campaign.bump_s, 0.2),
        geometry=bench.vehicle.geometry,
        structure=bench.vehicle.structure,
        facts=bench.vehicle.facts,
    )


def expected_vehicle(path: Path | None, session: Session | None) -> tuple[NDArray[np.float64], str]:
    """Return the parameters of the car that a campaign is planned for, (28,), and their source.

    They are those identified from a session, which is read from `path`; without one, and where
    that fails, those of the paper's car.
    """
    from daq import FORD_GRANADA
    from identify import Verdict, identify
    from identify.plan.design import full_vector
    from identify.plan.outlook import vague

    why = ""
    if session is not None:
        result = identify(session)
        undetermined = vague(result.parameters)
        if not result.parameters or result.quality.verdict is Verdict.REFUSED:
            why = f": the identification of {path} is refused"
        elif undetermined:
            why = f": {path} does not determine {', '.join(undetermined)}"
        else:
            curved = ", without its friction and its damper curves" if result.forces else ""
            values = {name: estimate.value for name, estimate in result.parameters.items()}
            return full_vector(values), f"the vehicle identified from {path}{curved}"
    values = dict(zip(FORD_GRANADA.__dataclass_fields__, FORD_GRANADA.to_array(), strict=True))
    return full_vector(values), f"the Ford Granada of the paper, as a typical car{why}"


# Gain by the weights on the car -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Gain:
    """Precision that a campaign with these weights is expected to reach."""

    worst: float | None = None
    mean: float | None = None
    """Largest and mean half 95 % interval as a share of the value; None if nothing is
    determined."""
    widest: str = ""
    """The parameter with the largest interval."""
    undetermined: tuple[str, ...] = ()
    """Parameters that the campaign cannot determine."""
    reasons: tuple[str, ...] = ()
    """Reasons why it cannot."""
    remedies: tuple[str, ...] = ()
    """Changes of the campaign that would determine these parameters."""
    error: str = ""
    """Reason why there is no answer; empty if there is one."""


GAIN = TypeAdapter(Gain)
"""Writes and reads the answer."""


def expected_gain(bench: Bench) -> Gain:
    """Return the precision expected from the campaign of a bench, on a car like its vehicle."""
    import numpy as np

    from daq.loading import expected_car
    from identify.plan.outlook import advise

    car = expected_car(bench.vehicle)
    advice = advise(planned(bench, car.to_array(), None, bench.campaign.bump_height_m))
    now = advice.outlook
    finite = np.isfinite(now.worst)
    return Gain(
        worst=now.worst if finite else None,
        mean=now.mean if finite else None,
        widest=max(now.relative, key=lambda name: now.relative[name]) if now.relative else "",
        undetermined=now.undetermined,
        reasons=now.reasons,
        remedies=advice.remedies or tuple(step.action for step in advice.steps[:2]),
    )


def main() -> int:
    """Answer the question on standard input."""
    from daq.bench.config import parse_bench
    from daq.journal.reader import last_recording

    question = json.load(sys.stdin)
    folder = Path(question["folder"])
    try:
        recording = last_recording(folder / "journal")
        database = recording.head.dbc_text if recording else None
        gain = expected_gain(parse_bench(question["bench"], "bench.toml", folder, database))
    except BumpbenchError as error:
        gain = Gain(error=str(error))
    sys.stdout.write(GAIN.dump_json(gain).decode())
    return 0


if __name__ == "__main__":
    sys.exit(main())
