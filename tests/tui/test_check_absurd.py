"""Values that no sensor shows are no numbers of a channel that is used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tui.cli import run

DBC = """VERSION ""
BU_: A
BO_ 256 Acc: 8 A
 SG_ z : 0|64@1- (1,0) [0|0] "m/s2" A
SIG_VALTYPE_ 256 z : 2;
"""
BENCH = 'dbc = "f.dbc"\n[[channel]]\nname = "acc"\nsignal = "Acc.z"\nquantity = "{quantity}"\n'


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("value", "quantity", "bad"),
    [
        (1e200, "body_acceleration", True),
        (-1e308, "body_acceleration", True),
        (np.inf, "body_acceleration", True),
        (1.1e6, "body_acceleration", True),
        (0.9e6, "body_acceleration", False),
        (1.1e6, "unused", False),  # a pressure in Pa, say
    ],
)
def test_one_is_a_fault_in_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], value: float, quantity: str, bad: bool
) -> None:
    """It was OK, with a warning of NumPy."""
    (tmp_path / "f.dbc").write_text(DBC)
    (tmp_path / "b.toml").write_text(BENCH.format(quantity=quantity))
    rng = np.random.default_rng(1)
    samples = 9.81 + rng.normal(0.0, 0.01, 1500)
    samples[700] = value
    lines = (
        f"({1.7e9 + 0.002 * k:.6f}) can0 100#{x.astype('<f8').tobytes().hex().upper()}\n"
        for k, x in enumerate(samples)
    )
    (tmp_path / "a.log").write_text("".join(lines))
    code = run(["check", str(tmp_path / "b.toml"), str(tmp_path / "a.log"), "--seconds", "2"])
    out = capsys.readouterr().out
    assert ("1 of 1000 samples are not numbers" in out or "1 of 1001 samples" in out) == bad
    assert not bad or code == 1
