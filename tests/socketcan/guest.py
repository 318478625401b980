"""Real SocketCAN on any machine: `python -m tests.socketcan.guest`.

A container or a cloud kernel has no CAN.  Here a Debian kernel that has it runs in QEMU, with
virtual CAN interfaces and two emulated Kvaser cards on one bus, and `inside.py` checks our reader
against it.  The guest has no disk and no network: its init ramdisk holds busybox and kernel
modules, everything else (Python, this repository, `ip`) is this machine's own file system,
read-only.  What is needed besides `ip` says `tests/machine.py`.
"""

from __future__ import annotations

import sys

from ..machine import run_guest

MODULES = ("virtio_pci", "9pnet_virtio", "9p", "vcan", "can-raw", "kvaser_pci")
TIME_LIMIT_S = 900
MORE = """
-m 512 -object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus
"""

INIT = """#!/bin/busybox sh
bb=/bin/busybox
$bb mkdir -p /proc /host
$bb mount -t proc proc /proc
for module in {modules}; do $bb insmod /$module; done
$bb mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 host /host
$bb mount -t proc proc /host/proc
$bb mount -t sysfs sys /host/sys
$bb mount -t devtmpfs dev /host/dev
$bb mount -t tmpfs tmp /host/tmp
cd /host
export PATH=/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
PYTHONPATH=$REPOSITORY PYTHONDONTWRITEBYTECODE=1 \\
    $bb chroot /host $PYTHON -m tests.socketcan.inside
$bb poweroff -f
"""


if __name__ == "__main__":
    sys.exit(run_guest("socketcan", INIT, MODULES, MORE.split(), TIME_LIMIT_S))
