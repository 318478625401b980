"""Watches the state of each bus: connection, traffic, load, and the errors of its controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

from ..bus.columns import wire_bits
from ..bus.error_frames import ControllerState, ErrorTally, tally_error_frames
from ..bus.source import LinkFacts, SourceLosses
from ..control.messages import BusState, BusStatus
from .inputs import WINDOW_S, Count, Key, fault

_CALM_S = 2.0
"""Time without an error, s, after which a controller that receives counts as error-active again:
many drivers do not report the change."""
_FULL_LOAD = 0.95
"""Load from which a bus counts as full: its frames of lowest priority are never sent."""
Traffic = tuple[float, int, int, float, int]
"""Monotonic time of a cycle; its good frames, error frames and bits; its latest time stamp."""


@dataclass(frozen=True, slots=True)
class BusWatch:
    """History of one bus."""

    name: str
    """Name of the link; the watch starts again when another link takes its place."""
    connected_s: float
    """Monotonic time since which it is connected, s."""
    heard_s: float
    """Monotonic time of the last frame of any kind; at least `connected_s`."""
    good_s: float
    """Monotonic time of the last good frame; at least `connected_s`."""
    frame_s: float | None = None
    """Monotonic time of the last good frame, also before the bus was lost; None before the
    first."""
    error_s: float = float("-inf")
    """Monotonic time of the last error frame; minus infinity before the first."""
    frames: int = 0
    """Good frames since the start."""
    error_frames: int = 0
    """Error frames since the start."""
    recent: tuple[Traffic, ...] = ()
    """Cycles of the last second, and the cycle before them."""
    last_ns: int = 0
    """Latest time stamp, ns."""
    controller: ControllerState | None = None
    """State that the controller reported last; None if it reported none."""
    tx_errors: int | None = None
    """Transmit error counter as reported last."""
    rx_errors: int | None = None
    """Receive error counter as reported last."""
    error_text: str = ""
    """The last error frame, in words."""
    losses: SourceLosses = field(default_factory=SourceLosses)
    """Losses that the source had counted in the last cycle."""


def advance_buses(
    watches: Sequence[BusWatch], links: Sequence[LinkFacts], batch: FrameBatch, now_s: float
) -> tuple[tuple[BusWatch, ...], dict[Key, Count]]:
    """Process a block.

    `watches`: result of the last call; empty at first.  `links`: the buses, in the order of their
    numbers.  `now_s`: monotonic time, s.  Returns the watch of each bus, and the counts of this
    cycle.
    """
    counts: dict[Key, Count] = {}
    bits = wire_bits(batch)
    done = []
    for number, link in enumerate(links):
        watch = (
            watches[number]
            if number < len(watches) and watches[number].name == link.name
            else BusWatch(link.name, now_s, now_s, now_s, losses=link.losses)
        )
        on_bus = batch.bus == number
        rows = slice(None) if on_bus.all() else np.flatnonzero(on_bus)
        done.append(_advance(watch, link, batch, rows, bits[rows], now_s, counts))
    return tuple(done), counts


def _advance(
    watch: BusWatch,
    link: LinkFacts,
    batch: FrameBatch,
    rows: NDArray[np.intp] | slice,
    bits: NDArray[np.float64],
    now_s: float,
    counts: dict[Key, Count],
) -> BusWatch:
    t_ns = batch.t_ns[rows]
    n, name = len(t_ns), link.name
    error_rows = np.flatnonzero(batch.flags[rows] & np.uint16(FrameFlag.ERROR))
    good = n - len(error_rows)
    tally = None
    if len(error_rows):
        tally = tally_error_frames(batch.select(rows).select(error_rows))
    back = 0
    if n:
        back = int(np.count_nonzero(t_ns[1:] < t_ns[:-1]))
        back += int(t_ns[0]) < watch.last_ns
    lost = {
        code: getattr(link.losses, field) - getattr(watch.losses, field)
        for code, field in (
            ("overrun", "dropped"),
            ("garbled", "garbled"),
            ("restamped", "restamped"),
        )
    }
    error_text = tally.text if tally else ""
    numbers = {
        **lost,
        "overrun": lost["overrun"] + (tally.overruns if tally else 0),
        "time_back": back,
        "error_frames": len(error_rows),
        "bus_off": tally.bus_off if tally else 0,
    }
    for code, number in numbers.items():
        if number > 0:
            detail = error_text if code in ("error_frames", "bus_off") else ""
            counts[code, name] = Count(number, detail)
    last_ns = int(t_ns[-1]) if n else watch.last_ns
    connected_s = watch.connected_s if link.connected else now_s
    earlier = [cycle for cycle in watch.recent if cycle[0] <= now_s - WINDOW_S][-1:]
    within = [cycle for cycle in watch.recent if cycle[0] > now_s - WINDOW_S]
    if n and not watch.last_ns:  # a bus has no time stamp before its first frame
        earlier, within = ([(*t[:4], int(t_ns[0])) for t in ts] for ts in (earlier, within))
    bits_sent = float(bits.sum()) - float(bits[error_rows].sum())
    advanced = replace(
        watch,
        connected_s=connected_s,
        heard_s=now_s if n else max(watch.heard_s, connected_s),
        good_s=now_s if good else max(watch.good_s, connected_s),
        frame_s=now_s if good else watch.frame_s,
        error_s=now_s if tally else watch.error_s,
        frames=watch.frames + good,
        error_frames=watch.error_frames + len(error_rows),
        recent=(*earlier, *within, (now_s, good, len(error_rows), bits_sent, last_ns)),
        last_ns=last_ns,
        error_text=error_text or watch.error_text,
        losses=link.losses,
    )
    if not link.connected:  # a controller that was opened again has a new state
        return replace(advanced, controller=None, tx_errors=None, rx_errors=None)
    return _controller(advanced, tally, error_rows, n, now_s)


def _controller(
    watch: BusWatch,
    tally: ErrorTally | None,
    error_rows: NDArray[np.intp],
    n: int,
    now_s: float,
) -> BusWatch:
    """Update the state of the controller by its reports and by the frames received since."""
    state, tx, rx = watch.controller, watch.tx_errors, watch.rx_errors
    row = -1
    if tally is not None:
        if tally.state is not None:
            state, row = tally.state, int(error_rows[tally.state_row])
        tx = tally.tx_errors if tally.tx_errors is not None else tx
        rx = tally.rx_errors if tally.rx_errors is not None else rx
    received_after = n - 1 - row - int(np.count_nonzero(error_rows > row)) > 0
    calm = now_s - watch.error_s >= _CALM_S and watch.good_s > watch.error_s
    proven = received_after if state is ControllerState.BUS_OFF else calm
    if state is not None and proven:
        state, tx, rx = ControllerState.ACTIVE, None, None
    return replace(watch, controller=state, tx_errors=tx, rx_errors=rx)


def bus_status(watch: BusWatch, link: LinkFacts, silent_s: float, now_s: float) -> BusStatus:
    """Return the status of a bus."""
    first, last = watch.recent[0], watch.recent[-1]
    # A replay faster than real time does not load a bus: its time stamps give the time it took.
    stamped_s = (last[4] - first[4]) * 1e-9 if first[4] else 0.0
    span_s = max(now_s - first[0], stamped_s, WINDOW_S / 10)
    return BusStatus(
        name=link.name,
        state=_state(watch, link, silent_s, now_s),
        load=sum(cycle[3] for cycle in watch.recent[1:]) / span_s / link.bitrate,
        frames_per_s=sum(cycle[1] for cycle in watch.recent[1:]) / span_s,
        frames=watch.frames,
        error_frames=watch.error_frames,
        reopened=link.reopened,
        tx_errors=watch.tx_errors,
        rx_errors=watch.rx_errors,
    )


def _state(watch: BusWatch, link: LinkFacts, silent_s: float, now_s: float) -> BusState:
    if not link.connected:
        return BusState.DISCONNECTED
    if watch.controller is ControllerState.BUS_OFF:
        return BusState.BUS_OFF
    if now_s - watch.good_s >= silent_s:
        return BusState.SILENT
    if watch.controller is ControllerState.PASSIVE:
        return BusState.ERROR_PASSIVE
    return BusState.OK


def bus_symptoms(
    watch: BusWatch, link: LinkFacts, status: BusStatus, silent_s: float, now_s: float
) -> list[Finding]:
    """Return the faulty states of a bus; counted faults are reported by `Window`."""
    name = link.name
    if status.state is BusState.DISCONNECTED:
        if not link.error and now_s - link.heartbeat_s < silent_s:
            return []  # it is being opened
        return [fault("disconnected", name, link.error or "not connected", advice=link.advice)]
    if status.state is BusState.BUS_OFF:
        return [fault("bus_off", name, watch.error_text)]
    found = []
    if link.interface_down:
        advice = f"`sudo ip link set {name.split()[-1]} up` brings it up again"
        found.append(fault("interface_down", name, "the interface is down", advice=advice))
    elif status.state is BusState.SILENT:
        errors = sum(cycle[2] for cycle in watch.recent)
        waited = f"{now_s - watch.good_s:.1f} s"
        if errors:
            frames = counted(errors, "error frame")
            text = f"{frames} in the last second and no good frame for {waited}"
            found.append(fault("check_bitrate", name, text))
        else:
            found.append(fault("bus_silent", name, f"no frame for {waited}"))
    elif status.load >= _FULL_LOAD:
        text = f"load {status.load:.0%} of {link.bitrate / 1e3:g} kbit/s"
        found.append(fault("bus_full", name, text))
    if watch.controller is ControllerState.PASSIVE:
        text = (
            f"{watch.tx_errors} transmit and "
            f"{counted(watch.rx_errors or 0, 'receive error')} counted"
            if watch.tx_errors is not None
            else watch.error_text
        )
        found.append(fault("error_passive", name, text))
    return found
