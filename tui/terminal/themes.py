"""High-contrast themes for a noisy hall; the built-in ones have none."""

from __future__ import annotations

from textual.theme import Theme

BENCH_DARK = Theme(
    name="bench-dark",
    primary="#4fb3ff",
    secondary="#8fd3ff",
    warning="#ffb000",
    error="#ff5c5c",
    success="#3ddc84",
    accent="#ffd54a",
    foreground="#ffffff",
    background="#000000",
    surface="#101418",
    panel="#1c2228",
    dark=True,
    text_alpha=1.0,
)
BENCH_LIGHT = Theme(
    name="bench-light",
    primary="#004a99",
    secondary="#003366",
    warning="#8a4b00",
    error="#a80000",
    success="#005c2e",
    accent="#5b2a86",
    foreground="#000000",
    background="#ffffff",
    surface="#f4f4f4",
    panel="#e2e2e2",
    dark=False,
    text_alpha=1.0,
)
THEMES = (BENCH_DARK, BENCH_LIGHT)
