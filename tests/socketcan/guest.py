"""Real SocketCAN on any machine: `python -m tests.socketcan.guest`.

A container or a cloud kernel has no CAN.  Here a Debian kernel that has it runs in QEMU, without
KVM, with virtual CAN interfaces and two emulated Kvaser cards on one bus, and `inside.py` checks
our reader against it.  The guest has no disk and no network: its init ramdisk holds busybox and
kernel modules, everything else (Python, this repository, `ip`) is this machine's own file system,
read-only.

Needed are `qemu-system-x86_64`, `dpkg-deb` and `ip`.  Kernel and busybox come from Debian packages:
the newest `linux-image-*-amd64*.deb` and `busybox-static_*.deb` in build/socketcan, which are
fetched by `apt-get download` if they are not there.  The ramdisk is built once.
"""

from __future__ import annotations

import gzip
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "socketcan"
MODULES = ("virtio_pci", "9pnet_virtio", "9p", "vcan", "can-raw", "kvaser_pci")
TIME_LIMIT_S = 900
MACHINE = """
-accel tcg,thread=multi -machine q35 -cpu max -smp 2 -m 512 -nographic -no-reboot -nic none
-virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap
-object can-bus,id=bus -device kvaser_pci,canbus=bus -device kvaser_pci,canbus=bus
"""
DIRECTORY, EXECUTABLE = 0o040755, 0o100755

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


def main() -> int:
    """Boot the guest, pass on what it says (TAP), and return 0 if all of it is well."""
    qemu = shutil.which("qemu-system-x86_64")
    if qemu is None:
        return _given_up("no qemu-system-x86_64 (Debian: apt install qemu-system-x86)")
    kernel, ramdisk = _built()
    # What the kernel does not know it hands to init as environment.
    settings = f"console=ttyS0 quiet loglevel=1 REPOSITORY={ROOT} PYTHON={sys.executable}"
    command = [qemu, *MACHINE.split(), "-kernel", str(kernel), "-initrd", str(ramdisk)]
    command += ["-append", settings]
    said = []
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as guest:
        limit = threading.Timer(TIME_LIMIT_S, guest.kill)
        limit.start()
        assert guest.stdout is not None
        for raw in guest.stdout:
            said.append(re.sub(rb"[^ -~]", b"", raw).decode())
            sys.stdout.write(said[-1] + "\n")
            sys.stdout.flush()
        limit.cancel()
    checks = [line for line in said if line.startswith(("ok ", "not ok "))]
    if f"1..{len(checks)}" not in said:
        return _given_up("the guest did not come to its end")
    return int(any(line.startswith("not ok ") for line in checks))


def _given_up(why: str) -> int:
    sys.stdout.write(f"Bail out! {why}\n")
    return 2


def _built() -> tuple[Path, Path]:
    """Return kernel and ramdisk."""
    ramdisk, tree = BUILD / "initrd.gz", BUILD / "tree"
    if not ramdisk.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        for pattern in ("linux-image-*_amd64.deb", "busybox-static_*.deb"):
            package = max(BUILD.glob(pattern), default=None) or _fetched(pattern)
            subprocess.run(["dpkg-deb", "-x", package, tree], check=True)
        _write_ramdisk(ramdisk, tree)
    return next(tree.glob("boot/vmlinuz-*")), ramdisk


def _fetched(pattern: str) -> Path:
    name = pattern.partition("_")[0]
    if name.endswith("*"):  # the kernel's package is named after its version
        said = _output("apt-cache", "depends", "linux-image-amd64")
        name = re.findall(r"Depends: (linux-image-\S+)", said)[0]
    subprocess.run(["apt-get", "download", "--quiet", name], cwd=BUILD, check=True)
    return next(BUILD.glob(pattern))


def _output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _write_ramdisk(ramdisk: Path, tree: Path) -> None:
    modules = _with_dependencies({path.stem: path for path in tree.rglob("*.ko")}, MODULES)
    text = INIT.format(modules=" ".join(path.name for path in modules))
    files = {"init": text.encode(), "bin/busybox": (tree / "bin/busybox").read_bytes()}
    files |= {path.name: path.read_bytes() for path in modules}
    entries = [_entry("bin", DIRECTORY, b""), _entry("dev", DIRECTORY, b"")]
    entries += [_entry(name, EXECUTABLE, data) for name, data in files.items()]
    ramdisk.write_bytes(gzip.compress(b"".join([*entries, _entry("TRAILER!!!", 0, b"")]), 1))


def _with_dependencies(known: dict[str, Path], names: Sequence[str]) -> list[Path]:
    """Return modules in an order in which they can be loaded."""
    order: list[Path] = []
    for name in names:
        path = known.get(name) or known[name.replace("_", "-")]
        before = re.findall(rb"\0depends=([^\0]*)\0", path.read_bytes())[0].decode()
        for module in [*_with_dependencies(known, before.split(",") if before else []), path]:
            if module not in order:
                order.append(module)
    return order


def _entry(name: str, mode: int, data: bytes) -> bytes:
    """Return a file as an entry of a cpio archive of the "newc" kind, which the kernel unpacks."""
    path = name.encode() + b"\0"
    numbers = (0, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(path), 0)
    head = b"070701" + b"".join(b"%08X" % number for number in numbers) + path
    return head + bytes(-len(head) % 4) + data + bytes(-len(data) % 4)


if __name__ == "__main__":
    sys.exit(main())
