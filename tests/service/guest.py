"""The service under a real systemd: `python -m tests.service.guest`.

A guest boots this machine's own file system, with all that is written kept in its memory, by this
machine's systemd.  The unit is that of `docs/`, with where Python is found added; `inside.py`
drives it from the boot to the end.  What is needed besides systemd says `tests/machine.py`.
"""

from __future__ import annotations

import compileall
import re
import sys
import sysconfig
from pathlib import Path

from daq.bench.config import load_bench

from ..machine import ROOT, run_guest

MODULES = ("virtio_pci", "9pnet_virtio", "9p", "overlay", "vcan", "can-raw")
TIME_LIMIT_S = 2700
MORE = ("-m", "3072")
PREFIX = Path(sys.base_prefix)
VERSION = f"python{sysconfig.get_python_version()}"
PYTHON = "/opt/venv/bin/python"
UNITS = "files/etc/systemd/system"

INIT = f"""#!/bin/busybox sh
bb=/bin/busybox
$bb mkdir -p /proc /lower /upper /host
$bb mount -t proc proc /proc
for module in {{modules}}; do $bb insmod /$module; done
$bb mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 host /lower
$bb mount -t tmpfs -o mode=755 tmp /upper
$bb mkdir -p /upper/changed /upper/work
$bb mount -t overlay -o lowerdir=/lower,upperdir=/upper/changed,workdir=/upper/work over /host
$bb rm -rf /host/etc/systemd/system/*.wants /host/etc/fstab
$bb cp -r /files/* /host/
$bb chmod 755 /host/etc /host/usr /host/usr/bin /host/usr/bin/bumpbench
$bb mkdir -p /host/opt/python /host/var/lib/private/bumpbench
$bb chmod 700 /host/var/lib/private
$bb mount -o bind /lower{PREFIX} /host/opt/python
$bb mkdir -p /host/opt/venv/bin
$bb ln -s /opt/python/bin/{VERSION} /host{PYTHON}
$bb mount -t tmpfs -o size=60m,mode=755 state /host/var/lib/private/bumpbench
$bb mount -t tmpfs -o mode=1777 tmp /host/tmp
$bb umount /proc
exec $bb switch_root /host /lib/systemd/systemd --unit=trial.target --show-status=yes \\
    --log-target=console --log-level=notice
"""

NOTHING = "[Service]\nType=oneshot\nRemainAfterExit=yes\nExecStart=/bin/true\n"
SLOW = ("tmpfiles-setup", "tmpfiles-setup-dev", "sysusers", "journal-flush", "update-utmp")
"""Units of systemd that would go through all of this machine's files."""
FILES = {
    # An environment as people install it: the child that reads a session ignores PYTHONPATH.
    "files/opt/venv/pyvenv.cfg": "home = /opt/python/bin\n",
    f"files/opt/venv/lib/{VERSION}/site-packages/bumpbench.pth": (
        f"{ROOT}\n{sysconfig.get_path('purelib')}\n"
    ),
    "files/usr/bin/bumpbench": f'#!/bin/sh\nexec {PYTHON} -m tui "$@"\n',
    f"{UNITS}/trial.target": (
        "[Unit]\nRequires=trial.service\nAfter=trial.service\nWants=bumpbench.service\n"
    ),
    f"{UNITS}/trial.service": f"""[Unit]
SuccessAction=poweroff-immediate
FailureAction=poweroff-immediate
[Service]
Type=oneshot
ExecStart={PYTHON} -m tests.service.inside
WorkingDirectory=/
Environment=PYTHONDONTWRITEBYTECODE=1 OPENBLAS_NUM_THREADS=1
StandardOutput=file:/dev/ttyS0
StandardError=file:/dev/ttyS0
""",
    f"{UNITS}/bumpbench.service.d/trial.conf": (
        "[Service]\nEnvironment=OPENBLAS_NUM_THREADS=1\n"
        # An emulated processor is some thirty times slower, the more so on a busy machine.
        "TimeoutStartSec=900\nWatchdogSec=60\nTimeoutStopSec=120\n"
    ),
}


def main() -> int:
    """Boot the guest with the unit and a bench, and return 0 if all is well."""
    unit = (ROOT / "docs" / "bumpbench.service").read_text("utf-8")
    bench = load_bench(None).text
    for key, value in (
        ("interface", '"socketcan"'),
        ("channel", '"vcan0"'),
        ("reserve_mb", "1"),
        ("excitations", '["bounce"]'),
        ("pre_s", "0.1"),
        ("post_s", "0.5"),
        ("rest_s", "0.1"),
    ):
        bench = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", bench, flags=re.MULTILINE)
    files = FILES | {f"{UNITS}/systemd-{name}.service": NOTHING for name in SLOW}
    files |= {f"{UNITS}/bumpbench.service": unit, "files/etc/bumpbench/bench.toml": bench}
    # The guest cannot keep what it compiles: a builder would compile all that it imports anew.
    compileall.compile_dir(ROOT, quiet=2, workers=0)
    shared = (ROOT, Path(sysconfig.get_path("purelib")), PREFIX)
    return run_guest("service", INIT, MODULES, MORE, TIME_LIMIT_S, files, shared)


if __name__ == "__main__":
    sys.exit(main())
