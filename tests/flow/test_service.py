"""The systemd unit: what it promises, checked by systemd's own tool where there is one."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import get_args

import pytest

from daq.alarms import EXPLAINED
from daq.control.messages import Order
from tui.cli import run
from tui.diagnostics import ExitCode

UNIT = Path(__file__).parents[2] / "docs" / "bumpbench.service"
MANUAL = UNIT.with_name("recorder.md")
BUSY_START_S = 34
"""The slowest start that was seen, two processors shared with 24 other processes."""
ANALYZE = shutil.which("systemd-analyze")


def settings() -> dict[str, str]:
    lines = [line for line in UNIT.read_text().splitlines() if "=" in line and line[0] != "#"]
    return dict(line.split("=", 1) for line in reversed(lines))


def test_the_unit_fits_the_recorder(capsys: pytest.CaptureFixture[str]) -> None:
    unit = settings()
    assert unit["Type"] == "notify"
    assert unit["WatchdogSec"] == "10"
    assert int(unit["TimeoutStartSec"]) >= 4 * BUSY_START_S
    words = shlex.split(unit["ExecStart"])
    assert words[0] == "/usr/bin/bumpbench"
    assert run([words[1], "--help"]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in words if word.startswith("--"))
    assert "--keep-on" in words
    for code in map(int, unit["RestartPreventExitStatus"].split()):
        assert code in {ExitCode.BAD_INPUT, ExitCode.LOCKED}
    # Without the second, libzmq aborts the process: seen when the unit was first booted.
    assert UNIT.read_text().count("\nSystemCallFilter=sched_setscheduler\n") == 1
    # A recorder needs its sockets, its buses and nothing else of the system.
    assert unit["RestrictAddressFamilies"] == "AF_UNIX AF_CAN AF_NETLINK"
    assert unit["CapabilityBoundingSet"] == ""
    for key in ("NoNewPrivileges", "ProtectHome", "PrivateTmp", "DynamicUser"):
        assert unit[key] == "yes"


@pytest.mark.parametrize("tool", [ANALYZE] if ANALYZE else [])
def test_systemd_finds_nothing_to_complain_of(tool: str, tmp_path: Path) -> None:
    """R14: exposure at most 2.0, and not a word from `verify`."""
    unit = tmp_path / UNIT.name
    # The program need not be installed where this is tested.
    unit.write_text(UNIT.read_text().replace("/usr/bin/bumpbench", "/bin/true"))
    verified = subprocess.run([tool, "verify", unit], capture_output=True, text=True, check=False)
    assert verified.stdout + verified.stderr == ""
    assert verified.returncode == 0
    rated = subprocess.run(
        [tool, "security", "--offline=true", "--no-pager", unit],
        capture_output=True,
        text=True,
        check=False,
    )
    exposure = re.search(r"exposure level for \S+: ([\d.]+)", rated.stdout)
    assert exposure
    assert float(exposure[1]) <= 2.0


def test_the_manual_names_every_alarm_exit_code_and_order() -> None:
    text = MANUAL.read_text()
    for code in EXPLAINED:
        assert f"| `{code}` |" in text, code
    for exit_code in ExitCode:
        assert re.search(rf"^\| {exit_code.value} \|", text, re.MULTILINE), exit_code
    for order in get_args(Order):
        assert f"`{order.__name__}`" in text, order
    for number in range(1, 17):
        assert f"| R{number} |" in text
