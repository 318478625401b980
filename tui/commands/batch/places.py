"""Finds the session files of a batch: on this machine, or at any address that fsspec knows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedIOBase
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dbc import InputError
from dbc.errors import printable

_ADVICE = "name session files, folders or patterns"


def session_files(names: Sequence[str]) -> list[str]:
    """Return the named session files, each once, as absolute paths or addresses.

    `names`: files, folders (every .h5 in them and below), patterns such as ``2026-*/*.h5``, each of
    them also as an address (``s3://bench-7/2026/``).  Raises InputError if a name matches no file.
    """
    found: dict[str, None] = {}
    for name in names:
        files = _remote(name) if is_remote(name) else _local(name)
        found |= dict.fromkeys(files)
    return list(found)


def is_remote(file: str) -> bool:
    """Return whether a file is named by an address."""
    return "://" in file


@contextmanager
def opened(file: str) -> Iterator[BufferedIOBase]:
    """Open a session file for reading.

    Raises OSError if that cannot be done.
    """
    if is_remote(file):
        import fsspec

        with _as_os_error(), fsspec.open(file, "rb") as stream:
            yield stream
    else:
        with Path(file).open("rb") as stream:
            yield stream


@contextmanager
def local_copy(file: str) -> Iterator[Path]:
    """Yield a session file as a local one; the copy of a remote file is deleted after its use.

    Raises OSError if it cannot be fetched.
    """
    if not is_remote(file):
        yield Path(file)
        return
    import fsspec

    with TemporaryDirectory(prefix="bumpbench-") as folder:
        copy = Path(folder) / "session.h5"
        with _as_os_error():
            system, path = fsspec.core.url_to_fs(file)
            system.get_file(path, str(copy))
        yield copy


def _local(name: str) -> list[str]:
    path = Path(name)
    if path.is_dir():
        files = sorted(path.rglob("*.h5"))
    elif path.exists() or not set(name) & set("*?["):
        files = [path]
    else:
        files = sorted(Path(path.anchor or ".").glob(str(path.relative_to(path.anchor))))
    # A link that leads nowhere is a session that fails, not one that hides the others.
    files = [file for file in files if file.is_file() or not file.exists()]
    if not files or (files == [path] and not path.exists()):
        what = "holds no session file (*.h5)" if path.is_dir() else "no such file"
        raise InputError(name, what, _ADVICE)
    return [str(file.absolute()) for file in files]


def _remote(name: str) -> list[str]:
    try:
        import fsspec
    except ModuleNotFoundError:
        what = "addresses need fsspec, which is not installed"
        raise InputError(name, what, "install bumpbench[remote]") from None
    try:
        with _as_os_error():
            system: Any
            system, path = fsspec.core.url_to_fs(name)
            if set(path) & set("*?["):
                files = sorted(system.glob(path))
            elif system.isdir(path):
                files = sorted(file for file in system.find(path) if file.endswith(".h5"))
            else:
                files = [path] if system.exists(path) else []
            found = [_address(name, str(system.unstrip_protocol(file))) for file in files]
    except OSError as error:
        advice = "check the address, its rights, and whether fsspec's library for it is installed"
        raise InputError(name, printable(f"cannot be reached: {error}", 300), advice) from None
    if not found:
        raise InputError(name, "no session file there", _ADVICE)
    return found


def _address(name: str, file: str) -> str:
    """Return the address of a file that was found under a name, through the same protocol chain.

    ``zip://*.h5::s3://bench/all.zip`` lies in an archive; ``simplecache::s3://bench/`` is cached.
    """
    parts = name.split("::")
    caches = next(i for i, part in enumerate(parts) if "://" in part)
    return "::".join([*parts[:caches], file, *parts[caches + 1 :]])


@contextmanager
def _as_os_error() -> Iterator[None]:
    """Convert any exception of a protocol's library to an OSError."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:  # each protocol has its own library
        raise OSError(f"{type(error).__name__}: {error}") from error
