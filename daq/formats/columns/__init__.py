"""Reads columns of numbers from files of other tools, for data that are already decoded."""

from __future__ import annotations

from .open_file import read_columns

__all__ = ["read_columns"]
