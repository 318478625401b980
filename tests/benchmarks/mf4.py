"""An MF4 bus log decoded from end to end, by us and by asammdf: `python -m tests.benchmarks.mf4 N`.

Each in a process of its own, interpreter and imports included: processor time and largest memory.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from .decode import database_text, interleaved_frames, write_mf4

FRAMES = 5_000_000
_OURS = """
from pathlib import Path
from daq import read_log
from dbc import load_codec
codec = load_codec(Path(DBC))
count = 0
for batch in read_log(Path(LOG)):
    count += sum(len(each.value) for each in codec.decode(batch).samples.values())
"""
_THEIRS = """
from asammdf import MDF
with MDF(LOG) as log:
    decoded = log.extract_bus_logging({"CAN": [(DBC, 0)]})
    count = sum(len(decoded.get(f"M{m}.s{s}", raw=True)) for m in range(4) for s in range(4))
"""
_AFTER = """
import resource
used = resource.getrusage(resource.RUSAGE_SELF)
# The resource's own memory is at least that of the process that started this one.
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(count, used.ru_utime + used.ru_stime, int(peak.split()[1]) / 1024)
"""


def measured(script: str, log: Path, dbc: Path) -> tuple[int, float, float]:
    """Return the samples that a script decodes, its processor time, s, and its memory, MiB."""
    text = f"LOG, DBC = {str(log)!r}, {str(dbc)!r}\n{script}{_AFTER}"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    count, used_s, memory_mib = done.stdout.splitlines()[-1].split()
    return int(count), float(used_s), float(memory_mib)


def main(n: int = FRAMES) -> None:
    """Print time, memory and ratio."""
    with TemporaryDirectory() as folder:
        log, dbc = Path(folder, "x.mf4"), Path(folder, "x.dbc")
        dbc.write_text(database_text())
        write_mf4(interleaved_frames(n, seed=1), log)
        found = {name: measured(s, log, dbc) for name, s in (("ours", _OURS), ("asammdf", _THEIRS))}
    for name, (count, used_s, memory_mib) in found.items():
        cost = f"{used_s:.1f} CPU s, {memory_mib:.0f} MiB"
        print(f"mf4, {n:,} frames, {name}: {count:,} samples, {cost}")
    print(f"mf4, asammdf over ours: {found['asammdf'][1] / found['ours'][1]:.2f}")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:2]))
