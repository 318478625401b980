"""A machine in QEMU without KVM: a Debian kernel, and this machine's own files, read-only.

Needed are `qemu-system-x86_64` and `dpkg-deb`.  Kernel and busybox come from Debian packages: the
newest `linux-image-*-amd64*.deb` and `busybox-static_*.deb` in build/guest, which are fetched by
`apt-get download` if they are not there.
"""

from __future__ import annotations

import gzip
import re
import shutil
import stat
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build" / "guest"
MACHINE = """
-accel tcg,thread=multi -machine q35 -cpu max -smp 2 -nographic -no-reboot -nic none
-virtfs local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap
"""
DIRECTORY, EXECUTABLE, FILE = 0o040755, 0o100755, 0o100644
_CONTROL = re.compile(rb"\x1b\[[0-9;?]*[A-Za-z]|[^ -~]")
"""What moves or colours the text of a console: systemd does before lines of ours."""


def run_guest(
    name: str,
    init: str,
    modules: Sequence[str],
    more: Sequence[str],
    limit_s: float,
    files: Mapping[str, str] = {},
    shared: Sequence[Path] = (),
) -> int:
    """Boot a guest, pass on what it says (TAP), and return 0 if all of it is well.

    `init`: script of process 1; `{modules}` in it stands for the names of the modules' files.
    `more`: words for QEMU.  `files`: texts in the ramdisk beside it, by path.
    `shared`: folders that another user than root reads in the guest.
    """
    qemu = shutil.which("qemu-system-x86_64")
    if qemu is None:
        return _given_up("no qemu-system-x86_64 (Debian: apt install qemu-system-x86)")
    if ROOT.is_relative_to("/tmp"):
        return _given_up("this checkout is in /tmp, of which a guest has its own: move it")
    if closed := closed_to_others(shared):
        return _given_up(f"other users cannot enter {closed}: chmod o+rx it, or move the checkout")
    kernel, ramdisk = _kernel(), BUILD / f"{name}.gz"
    _write_ramdisk(ramdisk, init, modules, files)
    # What the kernel does not know it hands to init as environment.
    settings = f"console=ttyS0 quiet loglevel=1 REPOSITORY={ROOT} PYTHON={sys.executable}"
    command = [qemu, *MACHINE.split(), *more, "-kernel", str(kernel), "-initrd", str(ramdisk)]
    command += ["-append", settings]
    said = []
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE) as guest:
        limit = threading.Timer(limit_s, guest.kill)
        limit.start()
        assert guest.stdout is not None
        for raw in guest.stdout:
            said.append(_CONTROL.sub(b"", raw).decode())
            sys.stdout.write(said[-1] + "\n")
            sys.stdout.flush()
        limit.cancel()
    checks = [line for line in said if line.startswith(("ok ", "not ok "))]
    if f"1..{len(checks)}" not in said:
        return _given_up("the guest did not come to its end")
    return int(any(line.startswith("not ok ") for line in checks))


def closed_to_others(folders: Sequence[Path]) -> Path | None:
    """Return the first folder, of these or above them, that other users cannot enter or read."""
    for folder in folders:
        for one in (*reversed(folder.parents), folder):
            needed = stat.S_IXOTH | (stat.S_IROTH if one == folder else 0)
            if one.stat().st_mode & needed != needed:
                return one
    return None


def _given_up(why: str) -> int:
    sys.stdout.write(f"Bail out! {why}\n")
    return 2


def _kernel() -> Path:
    """Return the kernel; the files of its package are next to it."""
    tree = BUILD / "tree"
    if not tree.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        for pattern in ("linux-image-*_amd64.deb", "busybox-static_*.deb"):
            package = max(BUILD.glob(pattern), default=None) or _fetched(pattern)
            subprocess.run(["dpkg-deb", "-x", package, tree], check=True)
    return next(tree.glob("boot/vmlinuz-*"))


def _fetched(pattern: str) -> Path:
    name = pattern.partition("_")[0]
    if name.endswith("*"):  # the kernel's package is named after its version
        said = _output("apt-cache", "depends", "linux-image-amd64")
        name = re.findall(r"Depends: (linux-image-\S+)", said)[0]
    subprocess.run(["apt-get", "download", "--quiet", name], cwd=BUILD, check=True)
    return next(BUILD.glob(pattern))


def _output(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def _write_ramdisk(
    ramdisk: Path, init: str, names: Sequence[str], texts: Mapping[str, str]
) -> None:
    tree = BUILD / "tree"
    modules = _with_dependencies({path.stem: path for path in tree.rglob("*.ko")}, names)
    text = init.replace("{modules}", " ".join(path.name for path in modules))
    files = {"init": text.encode(), "bin/busybox": (tree / "bin/busybox").read_bytes()}
    files |= {path.name: path.read_bytes() for path in modules}
    files |= {path: text.encode() for path, text in texts.items()}
    folders = {str(folder) for path in files for folder in Path(path).parents} - {"."} | {"dev"}
    entries = [_entry(name, DIRECTORY, b"") for name in sorted(folders)]
    modes = {name: EXECUTABLE if data[:2] == b"#!" else FILE for name, data in files.items()}
    modes["bin/busybox"] = EXECUTABLE
    entries += [_entry(name, modes[name], data) for name, data in files.items()]
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
