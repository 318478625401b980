"""Values printed in the paper, for comparison with ours."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

TABLE2_PERCENT: Mapping[str, float] = MappingProxyType(
    {
        "m_s": -0.011,
        "I_yy": -0.011,
        "I_xx": -0.023,
        "m_uf": 0.093,
        "m_ur": 0.095,
        "k_sf": -0.170,
        "k_sr": -0.078,
        "k_tf": -0.039,
        "k_tr": -0.032,
        "c_sf": -0.103,
        "c_sr": -0.087,
        "a": -0.141,
        "b": -0.130,
        "t_f": -0.205,
        "t_r": -0.161,
    }
)
"""Error of each parameter without noise.  The values printed next to them have a misprint (a =
1.282 m instead of 1.248 m) and are rounded for t_f and t_r; so the errors are the reliable
figures."""

TABLE3_PERCENT: Mapping[str, float] = MappingProxyType(
    {
        "m_s": -2.307,
        "I_yy": 3.536,
        "I_xx": -2.918,
        "m_uf": 1.928,
        "m_ur": -2.379,
        "k_sf": 1.594,
        "k_sr": -3.784,
        "k_tf": -2.248,
        "k_tr": 1.555,
        "c_sf": -3.647,
        "c_sr": 2.271,
    }
)
"""Error of each parameter with 30 dB of noise, a 16 Hz low-pass and the geometry measured."""
