"""Applies rules that bench.toml adds to the DBC: cycle, counter, checksum, time, sample sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from dbc import Codec
from dbc.layout import CRC_RULES, CounterRule, MessageLayout, SignalLayout
from dbc.units import to_si

from ..errors import InputError
from .toml_file import Table

CORRECT_MESSAGE = "correct that [[message]] in bench.toml"
CORRECT_SET = "correct that [[sample_set]] in bench.toml"


def _crc_rule(name: str) -> str:
    if name not in CRC_RULES:
        raise ValueError(f"is none of {', '.join(CRC_RULES)}")
    return name


class MessageRule(Table):
    """One `[[message]]`: properties of a message that its DBC does not state."""

    name: str
    """Name of the message."""
    cycle_ms: Annotated[float, Field(gt=0)] | None = None
    """Time between two frames, ms, instead of that of the DBC."""
    counter: str | None = None
    """Name of its rolling counter."""
    counter_modulus: Annotated[int, Field(ge=2, le=1 << 32)] | None = None
    """Number of values of the counter; None: all values of its bits."""
    crc: str | None = None
    """Signal that holds its checksum."""
    crc_rule: Annotated[str, AfterValidator(_crc_rule)] = "crc8_j1850"
    """Rule by which the checksum is computed, one of `dbc.layout.CRC_RULES`."""
    time_signal: str | None = None
    """Signal that holds the sensor's own time."""
    time_unit: Annotated[str, Field(max_length=16)] = ""
    """Its unit if the DBC states none or a wrong one; empty: as in the DBC."""
    time_wrap: Annotated[float, Field(gt=0)] | None = None
    """Value at which it starts again from 0, in its unit; None: at the end of its bits."""

    @model_validator(mode="after")
    def _belongs_to_something(self) -> MessageRule:
        stated = self.model_fields_set
        for owner, keys in (
            ("counter", {"counter_modulus"}),
            ("crc", {"crc_rule"}),
            ("time_signal", {"time_unit", "time_wrap"}),
        ):
            if keys & stated and owner not in stated:
                raise ValueError(f"{min(keys & stated)} says nothing without {owner}")
        return self


class SampleSet(Table):
    """One `[[sample_set]]`: messages that carry one sample together."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=60)]
    """Name of their sample group."""
    messages: Annotated[tuple[str, ...], Field(min_length=1)]
    """Names of the messages."""
    bound_by: str
    """``Message.signal``: a counter or time stamp in a separate frame that is sent in one burst
    with the others; or the name of a counter that each of the messages has."""

    @property
    def carrier(self) -> tuple[str, str]:
        """Message and signal by which the sets are numbered."""
        message, dot, signal = self.bound_by.rpartition(".")
        return (message, signal) if dot else (self.messages[0], self.bound_by)


@dataclass(frozen=True, slots=True)
class SensorClock:
    """A time stamp signal, resolved."""

    signal: str
    """``Message.signal``."""
    factor: float
    """Seconds per unit of the signal."""
    wrap: float
    """Value at which it starts again from 0, in its unit."""


def ruled_codec(codec: Codec, rules: Sequence[MessageRule], dbc_name: str) -> Codec:
    """Return the codec with the rules of bench.toml; applying them twice changes nothing.

    Raises InputError if a rule names a message or signal that is not in the DBC or cannot have that
    role.
    """
    if not rules:
        return codec
    by_name = {rule.name: rule for rule in rules}
    known = {message.name for message in codec.messages}
    for name in by_name:
        if name not in known:
            raise InputError(f"message {name}", f"is not in {dbc_name}", CORRECT_MESSAGE)
    messages = tuple(
        _ruled(message, by_name[message.name]) if message.name in by_name else message
        for message in codec.messages
    )
    return codec if messages == codec.messages else replace(codec, messages=messages)


def _ruled(message: MessageLayout, rule: MessageRule) -> MessageLayout:
    counter, crc, crc_rule = message.counter, message.crc, message.crc_rule
    if rule.counter is not None:
        signal = _plain(message, "counter", rule.counter)
        modulus = rule.counter_modulus or 1 << min(signal.length, 33)
        if signal.length > 32 or modulus > 1 << signal.length:
            what = f"counter {signal.name} of {signal.length} bits cannot run to {modulus}"
            raise InputError(f"message {message.name}", what, CORRECT_MESSAGE)
        counter = CounterRule(signal.name, modulus)
    if rule.crc is not None:
        signal = _plain(message, "crc", rule.crc)
        if signal.length != 8 or signal.low_bit != 0:
            what = f"checksum {signal.name} is not one whole byte"
            raise InputError(f"message {message.name}", what, CORRECT_MESSAGE)
        crc, crc_rule = signal.name, rule.crc_rule
    cycle_s = message.cycle_s if rule.cycle_ms is None else rule.cycle_ms * 1e-3
    return replace(message, cycle_s=cycle_s, counter=counter, crc=crc, crc_rule=crc_rule)


def _plain(message: MessageLayout, key: str, name: str) -> SignalLayout:
    """Return a signal that is an unsigned whole number in every frame."""
    signal = _signal(message, key, name, CORRECT_MESSAGE)
    if not signal.is_plain:
        what = f"{name} is not a plain unsigned number"
        raise InputError(f"message {message.name}", what, CORRECT_MESSAGE)
    return signal


def _signal(message: MessageLayout, key: str, name: str, advice: str) -> SignalLayout:
    """Return the signal that a key of bench.toml names."""
    try:
        return message.signal(name)
    except KeyError as error:
        what = f"has no signal {name}, which {key} names"
        raise InputError(f"message {message.name}", what, advice) from error


def sensor_clocks(codec: Codec, rules: Sequence[MessageRule]) -> Mapping[str, SensorClock]:
    """Return the time stamps of the messages that have one, by message name.

    Raises InputError if a time signal is missing, is not a time, or has no wrap.
    """
    return {
        rule.name: _clock(codec.by_name[rule.name], rule, rule.time_signal)
        for rule in rules
        if rule.time_signal and rule.name in codec.by_name
    }


def timed_messages(codec: Codec, rules: Sequence[MessageRule]) -> frozenset[str]:
    """Return the messages that carry the time of their samples as a counter or time stamp."""
    counted = {m.name for m in codec.messages if m.counter is not None and m.cycle_s is not None}
    return frozenset(counted | sensor_clocks(codec, rules).keys())


def _clock(message: MessageLayout, rule: MessageRule, name: str) -> SensorClock:
    signal = _signal(message, "time_signal", name, CORRECT_MESSAGE)
    where, unit = f"message {message.name}", rule.time_unit or signal.unit
    try:
        si = to_si(unit)
    except InputError as error:
        what = f"time signal {name} has the unknown unit {unit!r}"
        raise InputError(where, what, "state time_unit as s, ms, us or ns") from error
    if si.unit != "s" or signal.is_multiplexed:
        what = f"time signal {name} has the unit {unit!r}, not of time"
        raise InputError(where, what, "state time_unit as s, ms, us or ns")
    wrap = rule.time_wrap
    if wrap is None:
        if signal.is_float:
            what = f"time signal {name} is a float, whose bits set no wrap"
            raise InputError(where, what, "state time_wrap in its unit")
        wrap = abs(signal.factor) * float(1 << signal.length)
    return SensorClock(f"{message.name}.{name}", si.factor, wrap)


def check_sets(codec: Codec, rules: Sequence[MessageRule], sets: Sequence[SampleSet]) -> None:
    """Check that the messages of every set can be bound.

    Raises InputError if a message or the binding signal is missing, a message is in two sets, or
    the signal is neither a counter nor a time stamp.
    """
    messages = codec.by_name
    clocks = sensor_clocks(codec, rules)
    owner: dict[str, str] = {}
    for sample_set in sets:
        where = f"sample set {sample_set.name}"
        carrier, signal = sample_set.carrier
        for name in (*sample_set.messages, carrier):
            if name not in messages:
                raise InputError(where, f"the DBC has no message {name}", CORRECT_SET)
        for name in sample_set.messages:
            if name in owner:
                raise InputError(where, f"{name} is also in {owner[name]}", CORRECT_SET)
            owner[name] = sample_set.name
        _signal(messages[carrier], "bound_by", signal, CORRECT_SET)
        counter = messages[carrier].counter
        is_time = carrier in clocks and clocks[carrier].signal == f"{carrier}.{signal}"
        if not is_time and (counter is None or counter.signal != signal):
            what = f"{carrier}.{signal} is neither the counter nor the time_signal of its message"
            raise InputError(where, what, f"state it in [[message]] name = {carrier!r}")
        if not is_time and messages[carrier].cycle_s is None:
            what = f"{carrier} has no cycle time, and a counter alone gives no time"
            raise InputError(where, what, f"state cycle_ms in [[message]] name = {carrier!r}")
