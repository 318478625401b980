"""A SocketCAN source, and the other end of its socket."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from .socketcan_feed import Feed, udp_pair, unix_pair


@pytest.fixture(params=[unix_pair, udp_pair])
def feed(request: pytest.FixtureRequest) -> Iterator[Feed]:
    fed = Feed(request.param())
    yield fed
    fed.source.close()
    fed.sending.close()


@pytest.fixture
def udp() -> Iterator[Feed]:
    fed = Feed(udp_pair())
    yield fed
    fed.source.close()
    fed.sending.close()
