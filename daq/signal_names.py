"""Splits names of signals: ``Message.signal``, on some benches ``sensor.Message.signal``.

A bench that is a list of sensors names a signal ``sensor.Message.signal`` and a message
``sensor.Message``; names of sensors and signals hold no dot.
"""

from __future__ import annotations


def message_of(signal: str) -> str:
    """Return the name of the message that carries a signal."""
    return signal.rpartition(".")[0]


def signal_of(signal: str) -> str:
    """Return the name of a signal within its message."""
    return signal.rpartition(".")[2]


def sensor_of(message: str) -> str:
    """Return the name of the sensor that sends a message; empty on a bench with one DBC."""
    return message.rpartition(".")[0]


def sensor_of_signal(signal: str) -> str:
    """Return the name of the sensor that sends a signal; empty on a bench with one DBC."""
    return sensor_of(message_of(signal))
