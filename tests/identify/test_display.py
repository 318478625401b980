"""Notebooks show modes as tables."""

from __future__ import annotations

from html.parser import HTMLParser

import numpy as np

from identify import ModalModel


class _Cells(HTMLParser):
    """Collects the texts of cells and paragraphs."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.open: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []  # well-formed

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)
        if tag in ("tr", "p", "caption"):
            self.rows.append([])

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.rows[-1].append(data)


def test_modes_show_what_they_are() -> None:
    # 2 Hz, 10 % damped, the second entry opposite in phase and half as large.
    size = 2 * np.pi * 2.0
    pole = size * complex(-0.1, np.sqrt(1 - 0.01))
    shown = _Cells(ModalModel(np.array([pole]), np.array([[1.0], [-0.5 + 0j]]))._repr_html_())
    assert shown.rows[-1] == ["1", "2.0000", "0.1000", "1.00 ∠ 0°", "0.50 ∠ 180°"]


def test_modes_show_deviations_where_they_are_known_and_the_angle_of_what_moves() -> None:
    """Poles of |3 + 4i| and |6 + 8i|; an entry of 1e-9 of the largest has no angle."""
    poles = np.array([-6 + 8j, -3 + 4j])
    shapes = np.array([[1.0, 0.9e-9j], [-0.25j, complex(0.5, -0.0)], [2e-9j, 1.0]])
    model = ModalModel(poles, shapes, np.array([0.123, 0.0456]), np.array([np.nan, 0.002]))
    shown = _Cells(model._repr_html_())
    assert shown.rows[0] == ["2 modes"]
    assert shown.rows[1] == [
        "mode", "frequency, Hz", "std", "damping ratio", "std", "entry 1", "entry 2", "entry 3",
    ]  # fmt: skip
    slow = ["1", "0.7958", "0.046", "0.6000", "0.002", "0.00 ∠ 0°", "0.50 ∠ 0°", "1.00 ∠ 0°"]
    fast = ["2", "1.5915", "0.12", "0.6000", "1.00 ∠ 0°", "0.25 ∠ -90°", "0.00 ∠ 90°"]
    assert shown.rows[2:] == [slow, fast]
