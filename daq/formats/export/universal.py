"""Writes universal files of modal analysis (UFF): units, nodes, lines, time records, modes.

The formats are those that SDRC published; the docstring of each function states the layout of its
records.  Data are binary (58b, little-endian float64), because the text form has only 6 digits of a
time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.words import counted, plural

from ...channels import TIME_DERIVATIVE, Channel
from ...errors import printable
from ...runs import Run, SampleGroup
from ...sessions import Session
from ...vehicle import VehicleGeometry
from .car_nodes import LINES, Nodes, car_nodes, place_of, vertical_motion
from .frames import frames_left_out

_BEGIN = "    -1"
_TIME, _UNKNOWN = 17, 0
_DATA_TYPE = {0: 8, 1: 11, 2: 12}
"""Code of displacement, velocity, acceleration, by order of the time derivative."""


@dataclass(frozen=True, slots=True)
class ModeShapes:
    """Modes of one state of loading."""

    state: str
    """Name of the state."""
    geometry: VehicleGeometry
    """Lengths of the identified vehicle."""
    poles: NDArray[np.complex128]
    """Poles, rad/s, with positive imaginary parts, shape (m,)."""
    shapes: NDArray[np.complex128]
    """Mode shapes in the order of `daq.vehicle.DOF`, one column for each mode, shape (7, m)."""


def write_uff(session: Session, modes: Sequence[ModeShapes], path: Path) -> tuple[str, ...]:
    """Write datasets 164, 15, 82, one 58 per channel and run, and one 55 per mode.

    Returns notes on the contents of the session that the format cannot hold.
    """
    notes = []
    vehicle = session.vehicle
    if modes and vehicle.geometry is None:
        vehicle = replace(vehicle, geometry=modes[0].geometry)
    nodes = car_nodes(vehicle, session.channels)
    if not nodes:
        notes.append("nodes and lines are left out: wheel positions are not known (--modes)")
    missing = 0
    with path.open("wb") as stream:
        stream.write(_units())
        if nodes:
            stream.write(_nodes(nodes))
            for number, (name, line) in enumerate(LINES.items(), start=1):
                stream.write(_line(number, name, line))
        for run in session.runs:
            for group in run.groups:
                for number, channel in enumerate(session.channels):
                    values = group.values.get(channel.name)
                    if values is None or np.isfinite(values).sum() < 2:
                        continue
                    stream.write(_record(run, group, channel, place_of(number, channel)))
                    missing += int(np.sum(~np.isfinite(values)))
        for state in modes if nodes else ():
            stream.writelines(_modes(state, nodes, session.vehicle.name))
    if missing:
        notes.append(
            f"{counted(missing, 'missing sample is', 'missing samples are')} left out: "
            f"{plural(missing, 'its record is', 'their records are')} not equidistant"
        )
    return (*notes, *frames_left_out(session))


def _block(lines: Sequence[str], tail: bytes = b"") -> bytes:
    """Return a dataset between its delimiters."""
    return "".join(f"{line}\n" for line in [_BEGIN, *lines]).encode("ascii", "replace") + (
        tail + f"{_BEGIN}\n".encode()
    )


def _text(text: str) -> str:
    return f"{printable(text, 80) or 'NONE':<80}"


def _units() -> bytes:
    """Dataset 164: SI. (I10,20A1,I10), (3D25.17), (D25.17)."""
    one = "1.0000000000000000D+00"
    return _block(
        [
            f"{164:6d}{'':74}",
            f"{1:10d}{'SI: metre, newton':>20}{2:10d}",
            f"{one:>25}{one:>25}{one:>25}",
            f"{'2.7314999999999998D+02':>25}",
        ]
    )


def _nodes(nodes: Nodes) -> bytes:
    """Dataset 15: nodes. (4I10,1P3E13.5)."""
    rows = [
        f"{label:10d}{0:10d}{0:10d}{0:10d}" + "".join(f"{x:13.5E}" for x in place)
        for label, place in nodes.items()
    ]
    return _block([f"{15:6d}", *rows])


def _line(number: int, name: str, nodes: Sequence[int]) -> bytes:
    """Dataset 82: a line to draw. (3I10), (80A1), (8I10)."""
    rows = ["".join(f"{n:10d}" for n in nodes[i : i + 8]) for i in range(0, len(nodes), 8)]
    return _block([f"{82:6d}{'':74}", f"{number:10d}{len(nodes):10d}{0:10d}", _text(name), *rows])


def _record(run: Run, group: SampleGroup, channel: Channel, place: tuple[int, int, int]) -> bytes:
    """Dataset 58b: a function at a degree of freedom, binary, without its missing samples.

    (I6,1A1,2I6,2I12,4I..), 5 x (80A1), 2(I5,I10),2(1X,10A1,I10,I4), (3I10,3E13.5),
    4 x (I10,3I5,2(1X,20A1)), then the data.
    """
    node, direction, against = place
    values = group.values[channel.name]
    there = np.isfinite(values)
    time_s, values = group.time_s[there], values[there]
    start, step = time_s[0], (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    # The head has only six digits; if these do not give the times, every sample has its own.
    start, step = float(f"{start:13.5e}"), float(f"{step:13.5e}")
    even = int(np.array_equal(start + step * np.arange(len(time_s)), time_s))
    data = values if even else np.column_stack([time_s, values])
    tail = np.ascontiguousarray(data, "<f8").tobytes()
    when = datetime.fromtimestamp(run.t0_ns // 1_000_000_000, UTC)
    derivative = TIME_DERIVATIVE.get(channel.quantity)
    kind = _UNKNOWN if derivative is None else _DATA_TYPE[derivative]
    entity = "".join(c if c.isascii() and c.isprintable() else "?" for c in channel.name)[:10]
    head = [
        f"{58:6d}b{1:6d}{2:6d}{11:12d}{len(tail):12d}{0:6d}{0:6d}{0:12d}{0:12d}",
        _text(channel.name),
        _text(f"{run.label} {group.name} ({run.status})"),
        _text(f"{when:%d-%b-%y %H:%M:%S}".upper()),
        _text(f"mass state {run.mass_state}, {run.excitation}, repeat {run.repeat}"),
        _text(channel.signal),
        f"{1:5d}{0:10d}{0:5d}{0:10d} {entity or 'NONE':<10}{node:10d}{direction:4d}"
        f" {'NONE':<10}{against:10d}{direction if against else 0:4d}",
        f"{4:10d}{len(values):10d}{even:10d}{even * start:13.5e}{even * step:13.5e}{0.0:13.5e}",
        _axis(_TIME, "time", "s"),
        _axis(kind, str(channel.quantity), channel.unit),
        _axis(_UNKNOWN, "NONE", "NONE"),
        _axis(_UNKNOWN, "NONE", "NONE"),
    ]
    return _block(head, tail)


def _axis(kind: int, label: str, unit: str) -> str:
    return f"{kind:10d}{0:5d}{0:5d}{0:5d} {label[:20]:<20} {unit[:20] or 'NONE':<20}"


def _modes(state: ModeShapes, nodes: Nodes, vehicle: str) -> Iterator[bytes]:
    """Yield dataset 55 of each mode: complex shapes at the nodes, first order.

    5 x (80A1), (6I10), (4I10), (6E13.5), then per node (I10), (6E13.5).
    """
    for i, pole in enumerate(state.poles.tolist()):
        rows = []
        motion = vertical_motion(nodes, state.shapes[:, i], state.geometry)
        for label, z in motion.items():
            cells = (0.0, 0.0, 0.0, 0.0, z.real, z.imag)
            rows += [f"{label:10d}", "".join(f"{cell:13.5e}" for cell in cells)]
        yield _block(
            [
                f"{55:6d}{'':74}",
                _text(f"mode {i + 1} of state {state.state}"),
                _text(f"{abs(pole) / (2 * np.pi):.5g} Hz, damping {-pole.real / abs(pole):.4g}"),
                _text(vehicle),
                _text(state.state),
                _text("bumpbench"),
                f"{1:10d}{3:10d}{2:10d}{8:10d}{5:10d}{3:10d}",
                f"{2:10d}{6:10d}{0:10d}{i + 1:10d}",
                f"{pole.real:13.5e}{pole.imag:13.5e}{0:13.5e}{0:13.5e}{0:13.5e}{0:13.5e}",
                *rows,
            ]
        )
