"""`bumpbench plan`: predicts the precision of a campaign, and steps that would improve it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from .. import output
from ..options import JsonResult
from ..output import ExitCode

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from daq import Session
    from daq.bench.config import Bench
    from identify.plan.design import Plan
    from identify.plan.outlook import Advice, NextStep, Outlook


def plan(
    bench: Annotated[Path | None, Argument(help="bench.toml; default: the session's.")] = None,
    session: Annotated[Path | None, Option("--from", help="Session of the vehicle.")] = None,
    bump_mm: Annotated[
        float | None, Option(min=0.1, max=500, help="Height of the bump; default: bench.toml's.")
    ] = None,
    rate: Annotated[
        float | None, Option("--rate-hz", "--rate", min=40, max=5000, help="Default: the DBC's.")
    ] = None,
    json: JsonResult = False,
) -> int:
    """Predict how precisely a campaign will determine each parameter, and what to do next."""
    import daq
    from daq.bench.config import load_bench, parse_bench
    from identify.plan.outlook import KnownRuns, advise, compare_campaigns

    if bench is not None and session is None and bench.suffix.lower() in (".h5", ".hdf5"):
        bench, session = None, bench  # a session that is named alone
    with output.progress("plan") as stage:
        stage(0.05, "reading")
        recorded = None if session is None else daq.read_session(session)
        stored = recorded.provenance if recorded is not None else {}
        if bench is None and session is not None and "bench_toml" in stored:
            where = f"bench.toml in {session}"
            described = parse_bench(stored["bench_toml"], where, session.parent, stored.get("dbc"))
        else:
            described = load_bench(bench)
        stage(0.1, "expecting the vehicle")
        vehicle, vehicle_source = expected_vehicle(session, recorded)
        height_m = described.campaign.bump_height_m if bump_mm is None else bump_mm * 1e-3
        campaign = planned(described, vehicle, rate, height_m)
        runs = KnownRuns()  # their information is computed once for both
        stage(0.2, "driving over the bumps, and next steps")
        advice = advise(campaign, runs)
        stage(0.7, "other campaigns")
        others = compare_campaigns(campaign, runs)
    outlook = advice.outlook
    code = ExitCode.ANSWER_IS_NO if outlook.undetermined else ExitCode.OK
    if not json:
        _print_plan(campaign, advice, others, vehicle_source)
        return code
    output.print_json(
        {
            "vehicle": vehicle_source,
            "bump_mm": campaign.bump.height_m * 1e3,
            "decay_s": campaign.decay_s,
            "sensors": [
                {"name": s.channel.name, "noise": s.noise, "unit": s.channel.unit}
                | {"rate_hz": s.rate_hz}
                for s in campaign.sensors
            ],
            "runs": [
                {"mass_state": r.mass_state, "excitation": r.excitation, "repeats": r.repeats}
                for r in campaign.runs
            ],
            "parameters": {
                name: {**asdict(estimate), "relative_interval": outlook.relative.get(name)}
                for name, estimate in outlook.parameters.items()
            },
            **_precision(outlook),
            "reasons": list(outlook.reasons),
            "remedies": list(advice.remedies),
            "next_steps": [
                {"action": step.action, "worst_before": outlook.worst, "mean_before": outlook.mean}
                | _precision(step.outlook)
                for step in advice.steps
            ],
            "campaigns": [{"campaign": o.action, **_precision(o.outlook)} for o in others],
        }
    )
    return code


def planned(
    bench: Bench, vehicle: NDArray[np.float64], rate_hz: float | None, bump_height_m: float
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

    why_not = ""  # the car of the session is not taken
    if session is not None:
        result = identify(session)
        undetermined = vague(result.parameters)
        if not result.parameters or result.quality.verdict is Verdict.REFUSED:
            why_not = f": the identification of {path} is refused"
        elif undetermined:
            why_not = f": {path} does not determine {', '.join(undetermined)}"
        else:
            left_out = ", without its friction and its damper curves" if result.forces else ""
            values = {name: estimate.value for name, estimate in result.parameters.items()}
            return full_vector(values), f"the vehicle identified from {path}{left_out}"
    values = dict(zip(FORD_GRANADA.__dataclass_fields__, FORD_GRANADA.to_array(), strict=True))
    return full_vector(values), f"the Ford Granada of the paper, as a typical car{why_not}"


def _precision(outlook: Outlook) -> dict[str, Any]:
    """Return the widest and the mean relative interval, and what is not determined, for JSON."""
    names = list(outlook.undetermined)
    return {"worst": outlook.worst, "mean": outlook.mean, "undetermined": names}


def _print_plan(
    campaign: Plan, advice: Advice, others: tuple[NextStep, ...], vehicle_source: str
) -> None:
    """Print a campaign, its expected result, and what would improve it."""
    from identify.numbers import half_width, rounded

    outlook = advice.outlook
    runs = ", ".join(f"{r.repeats} x {r.mass_state} {r.excitation.words}" for r in campaign.runs)
    rates = sorted({sensor.rate_hz for sensor in campaign.sensors})
    rate_text = f"{rates[0]:g}" if len(rates) == 1 else f"{rates[0]:g} .. {rates[-1]:g}"
    output.print_line(f"Runs: {runs}; bump of {campaign.bump.height_m * 1e3:g} mm")
    sensors = f"{len(campaign.sensors)} at {rate_text} Hz"
    output.print_line(f"Sensors: {sensors}, with the usual noise of their kind")
    output.print_line(f"Vehicle: {vehicle_source}\n")
    rows = []
    for name, estimate in outlook.parameters.items():
        if name in outlook.undetermined:
            cells = ["not determined", ""]
        elif not estimate.std:
            cells = ["given", ""]
        else:
            relative = f"{outlook.relative[name] * 100:.2f} %" if name in outlook.relative else ""
            cells = [f"± {half_width(estimate.value, estimate.high)}", relative]
        value = rounded(estimate.value, estimate.low, estimate.high)[0]
        rows.append([name, value, *cells, estimate.unit])
    columns = ["parameter", "expected", "95 % interval", "±", "unit"]
    output.print_table("Expected result of this campaign", columns, rows)
    if outlook.undetermined:
        output.print_line(f"not determined: {', '.join(outlook.undetermined)}")
        for reason in outlook.reasons:
            output.print_item(reason)
        for action in advice.remedies:
            output.print_item(f"add: {action}")
        if not advice.remedies:
            output.print_item("no known step changes that")
        output.print_line()
    steps = [("(as planned)", outlook), *((step.action, step.outlook) for step in advice.steps)]
    title = "What would improve it (95 % intervals, share of the value)"
    _print_outlooks(title, "next step, each by itself", steps)
    if others:
        campaigns = [(other.action, other.outlook) for other in others]
        title = "Other campaigns with the same sensors"
        _print_outlooks(title, "campaign instead of it", campaigns)


def _print_outlooks(title: str, heading: str, rows: Sequence[tuple[str, Outlook]]) -> None:
    """Print the widest and the mean interval that each choice would give."""
    cells = [
        [name, f"{len(outlook.undetermined)} not determined", ""]
        if outlook.undetermined
        else [name, f"± {outlook.worst * 100:.2f} %", f"± {outlook.mean * 100:.2f} %"]
        for name, outlook in rows
    ]
    output.print_table(title, [heading, "worst", "mean"], cells)
