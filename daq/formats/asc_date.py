"""The date in the header of an ASC log, as written in English or German."""

from __future__ import annotations

import re
from datetime import datetime

_NAMES = "jan feb mar/mär apr may/mai jun jul aug sep oct/okt nov dec/dez"
_MONTHS = {
    name: number
    for number, names in enumerate(_NAMES.split(), start=1)
    for name in names.split("/")
}
_DATE = re.compile(
    r"(?P<month>[^\W\d]{3})[^\W\d]*\s+(?P<day>\d{1,2})\s+"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)(?:\.(?P<fraction>\d{1,9}))?"
    r"(?:\s+(?P<half>am|pm))?\s+(?P<year>\d{4})",
    re.IGNORECASE,
)


def asc_date_ns(line: str) -> int | None:
    """Return the date in a line as ns since 1970 UTC, None if there is none.

    Such a date is local time and names no zone: that of this machine is taken.
    """
    found = _DATE.search(line)
    if found is None or found["month"].lower() not in _MONTHS:
        return None
    hour = int(found["hour"])
    if found["half"]:
        hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
    try:
        date = datetime(
            int(found["year"]),
            _MONTHS[found["month"].lower()],
            int(found["day"]),
            hour,
            int(found["minute"]),
            int(found["second"]),
        )
        whole_s = round(date.timestamp())
    except (ValueError, OverflowError, OSError):
        return None
    return whole_s * 1_000_000_000 + int((found["fraction"] or "0").ljust(9, "0"))
