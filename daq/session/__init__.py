"""Reads and writes session files: HDF5, schema v1.

A session is one bench campaign on one vehicle: every run with its raw frames and its samples in SI,
the known facts on sensors, loads and vehicle, and the origin of the data.  The format is public:
any HDF5 reader opens a file (xarray, netCDF-C, MATLAB's low-level functions, h5dump).

Types: f8 float64, i8 int64, i4 int32, u4 u2 u1 unsigned, Sn text of at most n bytes UTF-8.
Attributes are UTF-8 text, integers or floats.  No compound types, no arrays of variable length, no
links, nothing virtual or external.  Filters: gzip, shuffle, fletcher32.  In a table each column is
a dataset, and all are equally long.  Every table has a dimension scale that counts its rows (fact,
channel, weight, frame, event), and every table of samples has `time`.  Units are SI.  Axes (ISO
8855): x forward, y left, z up, positions from the middle of the front axle.

/                   Conventions "CF-1.10"; NX_class; schema "bumpbench-session"; schema_version 1;
                    default: path of the first group of samples, if there is one
/session            vehicle: its name
                    a_m b_m t_f_m t_r_m: CG to front and rear axle, half tracks; all four or none
                    structure_symmetric structure_anti_roll_bars structure_tyre_damping
                    structure_cg_offset: 0 or 1, what the model of the vehicle has
                    element_NAME: 1 or 0, an element of a car that is not linear is forced or
                    forbidden (friction, bump_stops ...); absent: the data choose
                    provenance_NAME: text; created, software, uuid, hashes of what it was made from
/session/facts      what scales and tape measure say: fact; quantity S32 (a parameter or a load),
                    value f8, sigma f8 > 0, in the unit that the name ends in, else SI
/config/NAME        u1: a whole file (dbc, bench_toml, channel_map); attribute sha256 of its bytes
/channels           channel; name S64, quantity S32, unit S16; signal S128 ("Message.signal");
                    corner S2 (FL FR RL RR or empty); x_m y_m f8; position_sigma_m f8; at_cg u1;
                    sign gain tare motion_ratio f8: value = sign gain SI(signal) / motion_ratio -
                    tare; gain_sigma f8: relative; motion_ratio_sigma f8; delay_s
                    delay_sigma_s f8: how late the sensor is; low_pass_hz f8 (0: none),
                    low_pass_order i4;
                    signal_unit S16: the unit of the signal where the DBC is silent or wrong;
                    serial_number S64; calibrated S10: date
/mass_states/NAME   order: 0 is the baseline; weight; mass_kg sigma_kg x_m y_m height_m
                    position_sigma_m f8, hub S2
                    (a corner: the weight is on that hub; empty: on the body);
                    delta_mass f8 (7, 7) by row and column: a mass matrix given directly, for
                    heave, pitch and roll of the body, heave of the wheels FL FR RL RR
/runs/r001_LABEL    NX_class; mass_state, excitation (bounce pitch roll warp rear_pitch),
                    repeat: LABEL is the three with _; t0_ns: ns since 1970 UTC; bump_s: duration
                    of the bump, s, or NaN; status (accepted rejected); reasons: one a line
                    sample_groups: names of the groups of samples, one a line
                    lost_bus_dropped lost_bus_garbled lost_queue_dropped lost_counter_gaps
                    lost_crc_bad lost_wrong_length lost_unknown_id lost_error_frames
                    lost_remote_frames: frames lost or not decoded, by reason
  /GROUP            one sample clock, usually a message: NX_class NXdata; axes, signal,
                    auxiliary_signals (for viewers); channels: names, one a line
                    time f8: s since t0 by the sensor's clock, increasing; units, long_name
                    t_ns i8: bus time, ns since 1970 UTC; units, long_name
                    CHANNEL f8: SI; NaN where there is no value; units, quantity, dbc_signal
                    quality u1: flag_masks 1 2 4 8 16 32, flag_meanings counter_gap crc_bad
                    sentinel out_of_range interpolated missing
  /raw_busN         frames as received: bus: N; frame; t_ns i8; can_id u4 without flag bits;
                    flags u2 (1 extended, 2 remote, 4 error, 8 FD, 16 bit-rate switch, 32 error
                    state, 64 transmitted by this host); length u1: bytes; data u1 (n, 8 or 64) by
                    frame and byte, padded with zeros
  /events           event; t_ns i8, code S32, value f8, text S160

content_sha256      attribute of /session /config /channels /mass_states /runs and of each run:
                    SHA-256 of what is in it (daq.session.writing says how), so that a session that
                    was changed or damaged is refused; absent in older files.  What stands in other
                    groups of the root, as results in /identification, is free.  Behind the HDF5 a
                    line "bumpbench crc32 XXXXXXXX" has the checksum of all bytes before it; it is
                    gone when HDF5 writes to the file

Columns and attributes may be added within v1: a reader uses the default if an older file lacks one
(channels: all except name, quantity and unit), and ignores what it does not know.  Existing columns
and attributes never change their meaning.  Files are complete or absent: written under a temporary
name, synced and renamed.  Raw frames are never changed or deleted.
"""

from dbc.words import Finding as Finding
from dbc.words import Severity as Severity

from .reading import finding_document as finding_document
from .reading import read_session as read_session
from .reading import validate_session as validate_session
from .writing import write_session as write_session
