"""Reads CSV of python-can: timestamp,arbitration_id,extended,remote,error,dlc,data (base64)."""

from __future__ import annotations

from binascii import a2b_base64

from .reader import ERROR, EXTENDED, FD, REMOTE, Record, nanoseconds, number

LACKS = "CAN FD (with its bits BRS and ESI), bus and direction"


class CsvParser:
    """Parses CSV of python-can line by line; every line except the header is a frame."""

    states_length, spaced = True, False

    def __init__(self) -> None:
        self.has_header = False

    def __call__(self, line: bytes) -> Record | int | None:
        """Return the frame in a line; 0 for the header and empty lines."""
        if not self.has_header and line.startswith(b"timestamp,arbitration_id,"):
            self.has_header = True
            return 0
        cells = line.rstrip().split(b",")
        if len(cells) == 6:  # a frame without data
            cells.append(b"")
        try:
            time, identifier, *marks, dlc, data = cells
            extended, remote, error = ({b"0": False, b"1": True}[mark] for mark in marks)
            length = number(dlc, 10)
            letters = 0 if remote else (length + 2) // 3 * 4  # base64: 4 for up to 3 bytes
            if identifier[:2] != b"0x" or len(data) != letters:
                return None
            flags = EXTENDED * extended | REMOTE * remote | ERROR * error  # each true or false
            if length > 8:  # not stated, but no classic frame is longer
                flags |= FD
            payload = a2b_base64(data, strict_mode=True) if data else b""
            try:
                t_ns = nanoseconds(time)
            except ValueError:  # Python writes small ones with an exponent
                t_ns = round(float(time) * 1e9)
            return t_ns, number(identifier[2:], 16), flags, 0, length, payload
        except (ValueError, KeyError, OverflowError):
            return None if cells != [b""] else 0
