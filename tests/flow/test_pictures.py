"""The README's pictures show the program as it is: `make pictures` draws them anew."""

from __future__ import annotations

import asyncio
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from .pictures import DOCS, SIZES_PX, draw

ALIKE = 0.06
"""Mean difference of a colour, of 0 to 1, that another curve or another number may make."""


@pytest.mark.long
def test_the_pictures_of_the_readme_show_the_program_as_it_is(tmp_path: Path) -> None:
    asyncio.run(draw(tmp_path))
    for name in SIZES_PX:
        drawn, kept = (matplotlib.image.imread(folder / name) for folder in (tmp_path, DOCS))
        assert drawn.shape == kept.shape, name
        assert np.mean(np.abs(drawn - kept)) < ALIKE, name
        # A screen from elsewhere differs by more.
        assert np.mean(np.abs(drawn[::-1] - kept)) > ALIKE, name
