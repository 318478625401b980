"""Draws the figures of the studies as SVG; only these modules use matplotlib, without pyplot."""

from .sheet import svg

__all__ = ["svg"]
