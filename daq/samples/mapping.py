"""Maps signals of the DBC to channels of the bench: units, polarity, scale and zero."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from dbc.layout import MessageLayout, SignalLayout
from dbc.samples import Decoded, Samples
from dbc.units import SiUnit, known_si

from ..channels import LARGEST, SI_UNITS, Channel, Quantity, signal_of
from ..errors import InputError

# Defines the form in which samples of several channels are passed on ------------------------------

Column = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Time stamps, ns, and values, SI, of one channel, each of shape (n,)."""
SampleBlock = Mapping[str, Column]
"""The columns of some channels, by channel name."""


# The mapping --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """A channel and the conversion of its signal."""

    channel: Channel
    """The channel, with the unit filled in."""
    message: MessageLayout
    """The message that carries it."""
    factor: float
    offset: float
    """Offset of the SI value, which is factor * signal + offset, before sign, scale and tare."""

    @property
    def signal(self) -> SignalLayout:
        """The signal that carries the channel."""
        return self.message.signal(signal_of(self.channel.signal))

    @property
    def is_multiplexed(self) -> bool:
        """True if only some frames of the message hold the signal."""
        return self.signal.is_multiplexed

    @property
    def step(self) -> float:
        """Step of the converter in the channel's unit; 0 for a floating-point signal."""
        factor = 0.0 if self.signal.is_float else self.signal.factor
        return abs(self.factor * self.channel.scale * factor)

    def values(self, samples: Samples) -> NDArray[np.float64]:
        """Return the channel's values (`daq.channels.Channel`), (n,); NaN where unusable.

        A value that no sensor shows is unusable, unless the channel is only recorded.
        """
        value = channel_values(self.channel, self.factor, self.offset, samples.value)
        if samples.quality.any():
            value[~samples.usable] = np.nan
        if self.channel.quantity is not Quantity.UNUSED:
            value[np.abs(value) > LARGEST] = np.nan
        return value


def mapped_block(mapped: Iterable[MappedChannel], decoded: Decoded) -> SampleBlock:
    """Return the samples of the channels whose signals were received."""
    return {
        m.channel.name: (samples.t_ns, m.values(samples))
        for m in mapped
        if (samples := decoded.samples.get(m.channel.signal)) is not None
    }


def channel_values(
    channel: Channel, factor: float, offset: float, value: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the values of a channel; ``factor * value + offset`` is in SI units."""
    value = factor * value
    value += offset
    value *= channel.sign * channel.scale
    value -= channel.tare
    return value


def map_channels(
    channels: Sequence[Channel], messages: Sequence[MessageLayout], dbc_name: str
) -> tuple[MappedChannel, ...]:
    """Find the signal of every channel and check that its unit fits the quantity.

    Raises InputError if a signal is not in the DBC, or its unit is unknown or of another quantity.
    """
    known = {f"{m.name}.{s.name}": (m, s) for m in messages for s in m.signals}
    mapped = []
    for channel in channels:
        if channel.signal not in known:
            problem = f"{dbc_name} has no signal {channel.signal!r}"
            advice = (
                "write signal as Message.signal of the DBC, or as sensor.signal of a [[sensor]]"
            )
            if near := get_close_matches(channel.signal, known, 1):
                advice = f"did you mean {near[0]}?"
            raise InputError(f"signal of channel {channel.name}", problem, advice)
        message, signal = known[channel.signal]
        si = si_unit(channel, signal.unit, dbc_name)
        unit_channel = replace(channel, unit=si.unit)
        mapped.append(MappedChannel(unit_channel, message, si.factor, si.offset))
    return tuple(mapped)


def si_unit(channel: Channel, stated: str, source: str) -> SiUnit:
    """Return the conversion of a channel's signal to SI.

    `stated`: unit of the signal in `source`, a DBC or a file.  A channel that is only recorded
    keeps an unknown unit.  Raises InputError if the unit does not fit the quantity.
    """
    unit = channel.signal_unit or stated
    si = known_si(unit)
    expected = SI_UNITS.get(channel.quantity, "")
    if not expected:
        return si or SiUnit(1.0, 0.0, unit)
    if si is not None and si.unit == expected:
        return si
    where = "its [[channel]]" if channel.signal_unit else source
    unknown = "" if si else ", which is not known"
    problem = f"{channel.signal} has unit {unit!r} in {where}{unknown}"
    advice = "correct signal, signal_unit or quantity in its [[channel]]"
    if si is None:
        advice = "state signal_unit in its [[channel]]"
    needed = f"{channel.quantity} needs {expected} or a multiple"
    raise InputError(f"channel {channel.name}", f"{problem}; {needed}", advice)
