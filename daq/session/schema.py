"""Defines the names and limits of schema v1 that writer and reader share."""

from __future__ import annotations

SCHEMA = "bumpbench-session"
VERSION = 1
DAMAGED_ADVICE = "build it again from its journal"
"""Advice if a session file is damaged."""
TEXTS = ("dbc", "bench_toml", "channel_map")
"""Items of the provenance that are complete files and are stored in /config."""

RESERVED_IN_GROUP = {"time", "t_ns", "quality"}
"""Datasets of a sample group that are not channels."""
RAW_PREFIX = "raw_bus"
"""Prefix of the groups of raw frames in a run."""
RESERVED_IN_RUN = (RAW_PREFIX, "events")
"""Prefixes of the groups in a run that are not sample groups."""

CHANNEL_COLUMNS = {
    "name": "S64",
    "quantity": "S32",
    "unit": "S16",
    "signal": "S128",
    "corner": "S2",
    "x_m": "f8",
    "y_m": "f8",
    "position_sigma_m": "f8",
    "at_cg": "u1",
    "sign": "f8",
    "gain": "f8",
    "gain_sigma": "f8",
    "tare": "f8",
    "motion_ratio": "f8",
    "motion_ratio_sigma": "f8",
    "delay_s": "f8",
    "delay_sigma_s": "f8",
    "low_pass_hz": "f8",
    "low_pass_order": "i4",
    "signal_unit": "S16",
    "serial_number": "S64",
    "calibrated": "S10",
}
WEIGHT_COLUMNS = {
    "mass_kg": "f8",
    "sigma_kg": "f8",
    "x_m": "f8",
    "y_m": "f8",
    "height_m": "f8",
    "position_sigma_m": "f8",
    "hub": "S2",
}
FACT_COLUMNS = {"quantity": "S32", "value": "f8", "sigma": "f8"}
EVENT_COLUMNS = {"t_ns": "i8", "code": "S32", "value": "f8", "text": "S160"}
FRAME_COLUMNS = {"t_ns": "i8", "can_id": "u4", "flags": "u2", "length": "u1", "data": "u1"}
QUALITY_FLAGS = "counter_gap crc_bad sentinel out_of_range interpolated missing"
QUALITY_MASKS = (1, 2, 4, 8, 16, 32)
