"""Figures of the studies as SVG; the only place that knows matplotlib, and no state of pyplot."""

from .sheet import svg

__all__ = ["svg"]
