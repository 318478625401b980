"""The second secret of a display: a person who types it on the page may give orders there."""

from __future__ import annotations

import secrets

TRIES = 5
"""Wrong numbers in a minute after which none is accepted: to try a million then takes 140 days."""
LOCKED_S = 60.0
"""Time for which no number is accepted then, s."""
_MOST_PAGES = 32


class NoControlError(Exception):
    """A page gets no control; one line for a person."""


class Control:
    """A number that is shown at the terminal, and the pages on which it was typed."""

    def __init__(self) -> None:
        self.secret = f"{secrets.randbelow(10**6):06}"
        """Six digits."""
        self._wrong_s: list[float] = []
        self._pages: list[str] = []

    def grant(self, typed: str, now_s: float) -> str:
        """Return the key of a page on which the number was typed.

        `now_s`: of a clock that is never set.  Raises NoControlError for a wrong number, and for
        any after too many wrong ones.
        """
        self._wrong_s = [wrong_s for wrong_s in self._wrong_s if now_s - wrong_s < LOCKED_S]
        if len(self._wrong_s) >= TRIES:
            raise NoControlError("too many wrong numbers: wait a minute")
        digits = "".join(typed.split())
        if not secrets.compare_digest(digits.encode(), self.secret.encode()):
            self._wrong_s.append(now_s)
            raise NoControlError("that is not the number shown at the terminal")
        key = secrets.token_urlsafe()
        self._pages = [*self._pages[-_MOST_PAGES + 1 :], key]
        return key

    def holds(self, key: str) -> bool:
        """Return True if a page has control."""
        return any(secrets.compare_digest(key.encode(), page.encode()) for page in self._pages)
