"""Packs dots into characters: braille, quadrants, strokes, or one dot each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def _form(
    weights: list[list[int]], characters: str
) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    return np.array(weights, np.int64), np.array([ord(c) for c in characters], "<u4")


_FORMS = {
    (2, 4): _form(
        [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]],
        " " + "".join(chr(0x2800 + code) for code in range(1, 256)),
    ),
    (2, 2): _form([[1, 2], [4, 8]], " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"),
    (1, 3): _form([[1], [2], [4]], " '-^.|,|"),
    (1, 1): _form([[1]], " ."),
}
"""Weights of the dots of a character, by its dots across and down, and the character of each sum of
weights."""


def packed(dots: NDArray[np.bool_], across: int, down: int) -> list[str]:
    """Return the rows of characters that show a canvas of dots.

    `across` and `down`: dots of a character; the canvas has a multiple of them.
    """
    weights, characters = _FORMS[across, down]
    rows, columns = dots.shape
    cells = dots.reshape(rows // down, down, columns // across, across)
    codes = np.einsum("rdca,da->rc", cells, weights)
    return [row.tobytes().decode("utf-32-le") for row in characters[codes]]
