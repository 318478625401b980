"""The form of an added weight: fields, and the check that the weight is on the car."""

from __future__ import annotations

from collections.abc import Iterable

from daq import BodyWeight, Corner, HubWeight

from .fields import Field, FieldError, Values, check_fields, number, stated

Weight = BodyWeight | HubWeight
BODY = "body"
NEW_WEIGHT = {
    "place": BODY,
    "serial": "",
    "mass_kg": "",
    "sigma_kg": "0.01",
    "position_sigma_m": "0.005",
    "height_m": "0",
}
"""Values of the form before anything is typed."""

WEIGHT_FIELDS: tuple[Field, ...] = (
    Field("serial", "Serial", most=20,
          help="what is stamped on it; a bar-code line of serial, mass and ± fills three fields"),
    Field("mass_kg", "Mass", "kg", 0.1, 500.0, "a weight that a person or a crane puts on",
          "as weighed", True),
    Field("sigma_kg", "Mass ±", "kg", 0.0, 5.0, "weigh it if it is not known better",
          "tolerance of the weight, one standard deviation"),
    Field("place", "Place", needed=True, choices=(BODY, *Corner),
          help="body, or the hub that it is bolted to"),
    Field("x_m", "x", "m", -8.0, 3.0, "the weight must be on the car",
          "forward of the middle of the front axle; most are negative"),
    Field("y_m", "y", "m", -1.5, 1.5, "the weight must be on the car", "to the left of the middle"),
    Field("position_sigma_m", "Place ±", "m", 0.0, 0.2, "measure its place from the front axle",
          "how well x and y are known, one standard deviation"),
    Field("height_m", "Height", "m", -1.0, 2.0, "the weight must be on the car",
          "above the centre of gravity"),
)  # fmt: skip


_ON_BODY = {"x_m", "y_m", "position_sigma_m", "height_m"}
_OVERHANG_M, _BESIDE_M = 1.2, 0.3


def check_weight(values: Values, wheelbase_m: float, half_track_m: float) -> tuple[FieldError, ...]:
    """Check the form of one weight, and its place against the car's outline."""
    fields = [f for f in WEIGHT_FIELDS if values.get("place") == BODY or f.name not in _ON_BODY]
    errors = list(check_fields(fields, values))
    bad = {error.field for error in errors}
    mass, sigma = number(values.get("mass_kg", "")), number(values.get("sigma_kg", ""))
    if not bad & {"mass_kg", "sigma_kg"} and mass and sigma and sigma > 0.1 * mass:
        reason = f"± {sigma:g} kg is more than a tenth of {mass:g} kg: weigh it"
        errors.append(FieldError("sigma_kg", "Mass ±", f"0 to {0.1 * mass:g} kg", reason))
    if values.get("place") != BODY:
        return tuple(errors)
    for name, low, high in (
        ("x_m", -wheelbase_m - _OVERHANG_M, _OVERHANG_M),
        ("y_m", -half_track_m - _BESIDE_M, half_track_m + _BESIDE_M),
    ):
        field = next(f for f in WEIGHT_FIELDS if f.name == name)
        value, limit = number(values.get(name, "")), f"{low:.2f} to {high:.2f} m"
        if value is None:
            if name not in bad:
                reason = "is empty, and a weight on the body needs its place"
                errors.append(FieldError(name, field.label, limit, reason))
        elif name not in bad and not low <= value <= high:
            reason = f"{value:g} m is outside the car"
            errors.append(FieldError(name, field.label, limit, reason))
    return tuple(errors)


def weight_of(values: Values) -> Weight:
    """Return the weight that a checked form describes."""
    sigma = number(values.get("sigma_kg", "")) or 0.0
    mass = stated(values["mass_kg"])
    if values["place"] != BODY:
        return HubWeight(mass, Corner(values["place"]), sigma)
    height = number(values.get("height_m", "")) or 0.0
    place = number(values.get("position_sigma_m", "")) or 0.0
    return BodyWeight(mass, stated(values["x_m"]), stated(values["y_m"]), height, sigma, place)


def weight_values(weight: Weight, serial: str) -> dict[str, str]:
    """Return the form of an existing weight."""
    values = {
        "serial": serial,
        "mass_kg": f"{weight.mass_kg:.10g}",
        "sigma_kg": f"{weight.sigma_kg:.10g}",
    }
    if isinstance(weight, HubWeight):
        return values | {"place": str(weight.corner)} | dict.fromkeys(sorted(_ON_BODY), "")
    place = {name: getattr(weight, name) for name in sorted(_ON_BODY)}
    return values | {"place": BODY} | {name: f"{value:.10g}" for name, value in place.items()}


def check_inventory(weights: Iterable[Weight], total_kg: float) -> tuple[FieldError, ...]:
    """Check all weights together: at least one, and a plausible sum."""
    errors = []
    added = sum(weight.mass_kg for weight in weights)
    if added > 0.5 * total_kg:
        reason = f"the weights are {added:g} kg together on a car of {total_kg:.0f} kg"
        errors.append(FieldError("mass_kg", "Mass", f"{0.5 * total_kg:.0f} kg in all", reason))
    if not added:
        reason = "there is no weight: the added state would be the baseline again"
        errors.append(FieldError("mass_kg", "Mass", "one weight at least", reason))
    return tuple(errors)
