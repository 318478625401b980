"""Columns of numbers in files of other tools: data that are decoded already."""

from __future__ import annotations

from .read import read_columns

__all__ = ["read_columns"]
