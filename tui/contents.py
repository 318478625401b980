"""Shows the contents of a session file, for `inspect`: as tables and as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.sessions import notes_of, overrides_of

from .output import print_line, print_table
from .recorders.recording import print_summary, summary

if TYPE_CHECKING:
    from daq import BodyWeight, Channel, HubWeight, Session

_TEXTS = ("dbc", "bench_toml", "channel_map")
"""Provenance entries that hold whole files: their size is shown instead of their text."""


def contents_document(path: Path, session: Session) -> dict[str, Any]:
    """Return a session as a JSON document: runs, channels, vehicle, loads, provenance."""
    vehicle = session.vehicle
    return summary(path, session) | {
        "geometry": asdict(vehicle.geometry) if vehicle.geometry else None,
        "structure": asdict(vehicle.structure),
        "facts": [asdict(fact) for fact in vehicle.facts],
        "channels": [asdict(channel) for channel in session.channels],
        "mass_states": {
            state.name: {
                "weights": [asdict(weight) for weight in state.added.weights],
                "delta_mass": state.added.matrix.tolist(),
            }
            for state in session.mass_states
        },
        "provenance": _provenance(session.provenance),
    }


def _provenance(provenance: Mapping[str, str]) -> dict[str, str]:
    return {
        name: f"{len(text.encode('utf-8', 'surrogateescape'))} bytes" if name in _TEXTS else text
        for name, text in provenance.items()
    }


def print_contents(path: Path, session: Session) -> None:
    """Write a session as tables."""
    print_summary(path, session)
    print_line()
    rows = [
        [c.name, str(c.quantity), c.unit, _place(c), c.signal, _sensor(c)] for c in session.channels
    ]
    print_table("Channels", ["channel", "quantity", "unit", "place", "signal", "sensor"], rows)
    print_line()
    rows = []
    if session.vehicle.geometry is not None:
        rows += [[name, f"{x:g} m", ""] for name, x in asdict(session.vehicle.geometry).items()]
    rows += [[f.quantity, f"{f.value:g}", f"± {f.sigma:g}"] for f in session.vehicle.facts]
    rows += [
        ["model has", name, ""] for name, on in asdict(session.vehicle.structure).items() if on
    ]
    for state in session.mass_states:
        rows += [[f"in {state.name}", *_weight(weight)] for weight in state.added.weights]
        if state.added.matrix.any():
            rows.append([f"in {state.name}", "a mass matrix", ""])
    if rows:
        print_table("Known beforehand", ["what", "value", ""], rows)
        print_line()
    shown = _provenance(session.provenance)
    if "verdicts" in shown:
        shown["verdicts"] = "findings of each run: --json shows them"
    rows = [[name, text] for name, text in shown.items() if name not in ("notes", "overrides")]
    rows += [["note", text] for text in notes_of(session.provenance)]
    rows += [["warning overridden", text] for text in overrides_of(session.provenance)]
    if rows:
        print_table("Provenance", ["what", "value"], rows)


def _place(channel: Channel) -> str:
    if channel.corner is not None:
        return str(channel.corner)
    if channel.at_cg:
        return "CG"
    if channel.quantity.startswith("body"):
        sigma = f" ± {channel.position_sigma_m:g}" if channel.position_sigma_m else ""
        return f"x {channel.x_m:g} y {channel.y_m:g}{sigma} m"
    return "body" if channel.quantity != "unused" else ""


def _sensor(channel: Channel) -> str:
    """Return the properties that distinguish a sensor from an ideal one, as text."""
    parts = []
    if channel.sign * channel.gain != 1.0:
        parts.append(f"times {channel.sign * channel.gain:g}")
    if channel.scale_sigma:
        parts.append(f"± {channel.scale_sigma * 100:.2g} %")
    if channel.tare:
        parts.append(f"tare {channel.tare:g}")
    if channel.delay_s:
        parts.append(f"{channel.delay_s * 1e3:g} ms late")
    if channel.low_pass_hz:
        parts.append(f"low-pass {channel.low_pass_hz:g} Hz")
    return ", ".join(parts)


def _weight(weight: BodyWeight | HubWeight) -> list[str]:
    place = asdict(weight)
    at = (
        f"at hub {place['corner']}"
        if "corner" in place
        else f"at x {place['x_m']:g} y {place['y_m']:g} m"
    )
    if place.get("position_sigma_m"):
        at += f" ± {place['position_sigma_m']:g}"
    return [f"{weight.mass_kg:g} kg {at}", f"± {weight.sigma_kg:g}" if weight.sigma_kg else ""]
