"""The form of the vehicle and its campaign: fields, plausibility, and conversion to bench.toml."""

from __future__ import annotations

from collections.abc import Mapping

from daq import Bench, Excitation
from daq.bench import Method, campaign_limits
from daq.vehicle import Fact, FactQuantity, Structure

from .fields import NO, YES, Field, FieldError, Values, check_fields, number, stated

_SCALES = "what the scales may be off by, one standard deviation"
_TAPE = "what the tape may be off by, one standard deviation"
_SIGMA = "an uncertainty of nothing would outweigh every sensor"


def _fact(name: str, label: str, unit: str, low: float, high: float, why: str) -> tuple[Field, ...]:
    weighed = unit == "kg"
    method = "scales under the wheels, car as in the baseline" if weighed else "with a tape measure"
    most = 0.05 * high
    return (
        Field(name, label, unit, low, high, why, f"{method}; leave empty if it was not measured"),
        Field(f"{name}.sigma", f"{label} ±", unit, 1e-3 if weighed else 1e-4, most, _SIGMA,
              _SCALES if weighed else _TAPE),
    )  # fmt: skip


def _number(name: str, label: str, unit: str, why: str, text: str, *, whole: bool = False) -> Field:
    low, high, above_low = campaign_limits(name)
    return Field(name, label, unit, low, high, why, text, True, whole=whole, above_low=above_low)


_CAR_KG = "from a formula car to a loaded van"
FACTS: tuple[tuple[FactQuantity, str, str, float, float, str], ...] = (
    (FactQuantity.TOTAL_MASS, "Total mass", "kg", 100.0, 10_000.0, _CAR_KG),
    (FactQuantity.FRONT_AXLE, "Front axle", "kg", 40.0, 6_000.0, _CAR_KG),
    (FactQuantity.REAR_AXLE, "Rear axle", "kg", 40.0, 6_000.0, _CAR_KG),
    (FactQuantity.WHEELBASE, "Wheelbase", "m", 1.0, 6.0, "the distance between the axles"),
    (FactQuantity.FRONT_TRACK, "Front track", "m", 0.8, 2.6, "tyre middle to tyre middle"),
    (FactQuantity.REAR_TRACK, "Rear track", "m", 0.8, 2.6, "tyre middle to tyre middle"),
)
USUAL_SIGMA = {"kg": 1.0, "m": 0.003}
_FLAGS = (
    ("symmetric", "Left = right", "springs, dampers, tyres and wheels alike on both sides"),
    ("anti_roll_bars", "Anti-roll bars", "a bar on each axle is identified, too"),
    ("tyre_damping", "Tyre damping", "a damper parallel to each tyre's spring"),
    ("cg_offset", "CG off the middle", "the centre of gravity may lie left or right"),
)
_TIMES = "number of accepted runs of each excitation, without and with the added mass"

VEHICLE_FIELDS: tuple[Field, ...] = (
    Field("name", "Vehicle", needed=True, help="number plate or chassis number"),
    Field("operator", "Operator", needed=True, most=40, help="your name, for every verdict"),
    *(field for fact in FACTS for field in _fact(*fact)),
    *(Field(f"flag.{n}", label, choices=(YES, NO), help=text) for n, label, text in _FLAGS),
    *(
        Field(f"bump.{e}", words.capitalize(), choices=(YES, NO), help=f"whether {words} is bumped")
        for e, words in ((e, e.words) for e in Excitation)
    ),
    _number("repeats", "Repeats", "runs", _TIMES, _TIMES, whole=True),
    Field("method", "Method", needed=True, choices=tuple(Method),
          help="roll over boards, drop off blocks, or push by hand"),
    _number("bump_height_mm", "Bump height", "mm", "above 50 mm wheels leave the ground",
            "height of board or block, or depth of the push: 50 mm or less"),
    _number("accept_after_s", "Accept after", "s", "the operator's time to reject a run",
            "the next run arms itself after this"),
    Field("notes", "Notes", most=500, help="tyre pressures, fuel, what is odd: for the report"),
)  # fmt: skip


def check_vehicle(values: Values, bench: Bench) -> tuple[FieldError, ...]:
    """Check the whole form of the vehicle."""
    errors = list(check_fields(VEHICLE_FIELDS, values))
    bad = {error.field for error in errors}
    known = {
        FactQuantity(name): value
        for name, *_ in FACTS
        if name not in bad and (value := number(values.get(name, ""))) is not None
    }
    for name, label, unit, *_ in FACTS:
        if name in known and not values.get(f"{name}.sigma", "").strip():
            reason = f"{label} needs the uncertainty that goes with it"
            errors.append(FieldError(f"{name}.sigma", f"{label} ±", f"above 0 {unit}", reason))
    errors += _loads(known)
    errors += _lengths(known, bench)
    if not any(values.get(f"bump.{e}") == YES for e in Excitation):
        reason = "no excitation is chosen: nothing would be bumped"
        errors.append(FieldError("bump.bounce", "Bounce", "at least one excitation", reason))
    return tuple(errors)


def _loads(known: Mapping[FactQuantity, float]) -> list[FieldError]:
    total, front, rear = (
        known.get(q)
        for q in (FactQuantity.TOTAL_MASS, FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE)
    )
    if total is None:
        return []
    errors = []
    if front is not None and rear is not None and abs(front + rear - total) > 0.01 * total:
        reason = f"the axles carry {front + rear:g} kg together, the total is {total:g} kg"
        errors.append(
            FieldError(FactQuantity.TOTAL_MASS, "Total mass", "axles and total within 1 %", reason)
        )
    for name, label, load in (
        (FactQuantity.FRONT_AXLE, "Front axle", front),
        (FactQuantity.REAR_AXLE, "Rear axle", rear),
    ):
        if load is not None and load >= total:
            reason = f"{load:g} kg on one axle of a car of {total:g} kg"
            errors.append(FieldError(name, label, "less than the total mass", reason))
    return errors


def _lengths(known: Mapping[FactQuantity, float], bench: Bench) -> list[FieldError]:
    given = bench.vehicle.geometry
    if given is None:
        return []
    lengths = {
        FactQuantity.WHEELBASE: ("Wheelbase", given.a + given.b),
        FactQuantity.FRONT_TRACK: ("Front track", 2.0 * given.t_f),
        FactQuantity.REAR_TRACK: ("Rear track", 2.0 * given.t_r),
    }
    return [
        FieldError(
            name, label, f"{length:g} m within 2 %",
            f"{known[name]:g} m does not fit [vehicle.geometry] of bench.toml",
        )
        for name, (label, length) in lengths.items()
        if name in known and abs(known[name] - length) > 0.02 * length
    ]  # fmt: skip


def vehicle_values(bench: Bench, operator: str) -> dict[str, str]:
    """Return the form filled with the bench in force."""
    facts = {fact.quantity: fact for fact in bench.vehicle.facts}
    values = {"name": bench.vehicle.name, "operator": operator, "notes": ""}
    for name, _, unit, *_ in FACTS:
        fact = facts.get(name)
        values[str(name)] = f"{fact.value:.10g}" if fact else ""
        values[f"{name}.sigma"] = f"{fact.sigma:.10g}" if fact else f"{USUAL_SIGMA[unit]:g}"
    for flag, *_ in _FLAGS:
        values[f"flag.{flag}"] = YES if getattr(bench.vehicle.structure, flag) else NO
    for excitation in Excitation:
        values[f"bump.{excitation}"] = YES if excitation in bench.campaign.excitations else NO
    return values | {
        "repeats": str(bench.campaign.repeats),
        "method": str(bench.procedure.method),
        "bump_height_mm": f"{bench.procedure.bump_height_m * 1e3:.10g}",
        "accept_after_s": f"{bench.procedure.accept_after_s:.10g}",
    }


def vehicle_text(text: str, bench: Bench, values: Values) -> str:
    """Return bench.toml with the values of the checked form.

    Facts for which the form has no field stay.
    """
    from daq.bench import with_campaign, with_facts, with_vehicle

    here = {name for name, *_ in FACTS}
    facts = [fact for fact in bench.vehicle.facts if fact.quantity not in here]
    for name, *_ in FACTS:
        value, sigma = number(values[name]), number(values[f"{name}.sigma"])
        if value is not None and sigma is not None:
            facts.append(Fact(str(name), value, sigma))
    flags = {flag: values[f"flag.{flag}"] == YES for flag, *_ in _FLAGS}
    text = with_vehicle(text, values["name"].strip(), Structure(**flags))
    if set(facts) != set(bench.vehicle.facts):
        text = with_facts(text, facts)
    now = bench.campaign.excitations
    chosen = [e for e in Excitation if values[f"bump.{e}"] == YES]
    order = [e for e in now if e in chosen] + [e for e in chosen if e not in now]
    return with_campaign(
        text,
        order,
        round(stated(values["repeats"])),
        Method(values["method"]),
        stated(values["bump_height_mm"]) * 1e-3,
        stated(values["accept_after_s"]),
    )
