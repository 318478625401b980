import numpy as np
import pytest

from dbc import FrameBatch


def _frames(t_ns: list[int], bus: list[int]) -> FrameBatch:
    n = len(t_ns)
    return FrameBatch(
        np.array(t_ns, np.int64),
        np.arange(n, dtype=np.uint32),
        np.zeros(n, np.uint16),
        np.array(bus, np.uint8),
        np.full(n, 8, np.uint8),
        np.zeros((n, 8), np.uint8),
    )


FRAMES = _frames([30, 10, 20, 10, 40], [0, 1, 2, 0, 1])


@pytest.mark.parametrize(
    ("spans", "kept"),
    [
        ([(10, 30)], [1, 2, 3]),  # from the first stamp, until before the last
        ([(11, 31)], [0, 2]),
        ([(0, 11), (40, 41)], [1, 3, 4]),
        ([(0, 10), (41, 50)], []),
        ([(10, 30), (20, 40)], [0, 1, 2, 3]),  # each frame once
        ([], []),
    ],
)
def test_frames_within_spans(spans: list[tuple[int, int]], kept: list[int]) -> None:
    assert FRAMES.within(spans).can_id.tolist() == kept


def test_frames_on_buses() -> None:
    assert FRAMES.on_buses({1, 2}).can_id.tolist() == [1, 2, 4]
    assert FRAMES.on_buses({3}).can_id.tolist() == []
    assert FRAMES.on_buses(frozenset()) is FRAMES


def test_frames_of_one_time_keep_their_order() -> None:
    frames = _frames([1, 0] * 500, [0] * 1000)
    assert frames.by_time().can_id.tolist() == [*range(1, 1000, 2), *range(0, 1000, 2)]
