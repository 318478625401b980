"""The lines around every screen, each by itself in a terminal of a known width."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from textual.content import Content

from daq.bench.campaign import Origin
from daq.control.messages import BusState, BusStatus
from daq.runs import Losses
from tui.terminal.state.campaign import BenchStep
from tui.terminal.state.feed import STARTING, Lost
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.widgets.bars import StepBar, TopLine, Words

from .alone import alone, text
from .fake_recorder import FakeRecorder

ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")
STATUS = FakeRecorder().status


def context(**changes: Any) -> Any:
    plain = {
        "lost": None, "operator": "MK", "in_control": True,
        "signals": SimpleNamespace(sound=True),
    }  # fmt: skip
    return SimpleNamespace(**plain | changes)


def style(line: Words, words: str) -> str:
    """Return how the first of these words are shown."""
    content = line.render()
    assert isinstance(content, Content)
    at = content.plain.index(words)
    return " ".join(str(span.style) for span in content.spans if span.start <= at < span.end)


async def test_the_top_line_of_a_narrow_terminal() -> None:
    line = TopLine(ASCII)

    def said(app: Any = None, **changes: Any) -> str:
        line.show(replace(STATUS, **changes), app or context())
        (only,) = text(line)
        return only

    async with alone(line, 119, 3) as _:
        assert said().startswith(" BUMP  Ford Granada · 2026-11-21 · op. MK  ")
        assert said().endswith("   │ can0 * 38%  4/4 alive  disk 81 GB")
        assert len(said()) == 119, "both ends of the line"
        assert "lost" not in said()
        assert said(losses=Losses(bus_dropped=2, counter_gaps=1)).endswith("lost 3  disk 81 GB")
        assert style(line, "lost 3") == "bold $warning"
        assert said(sensors_alive=3).endswith("3/4 alive  disk 81 GB")
        disk = replace(STATUS.disk, free_bytes=999_999_999)
        assert said(disk=disk).endswith("disk 1000 MB")
        assert said(disk=replace(disk, free_bytes=1_000_000_000)).endswith("disk 1 GB")
        assert said(context(signals=SimpleNamespace(sound=False))).endswith("disk 81 GB  muted")
        assert " VIEWER, MK in control " in said(context(in_control=False))
        free = said(context(in_control=False), controller="")
        assert " VIEWER, no terminal in control " in free
        over = said(overloaded=("hub_acc_fl", "hub_acc_fr", "hub_acc_rl"))
        assert "│ ^ OVERLOAD hub_acc_fl, hub_acc_f" in over
        buses = (
            BusStatus("socketcan can1", BusState.OK, 0.384, 4e3, 10, 0, 0),
            BusStatus("vector 12345", BusState.BUS_OFF, 0.0, 0.0, 0, 9, 0),
        )
        assert "can1 * 38%  12345 x BUS-OFF  4/4" in said(buses=buses)
        marked = said(origin=Origin.SIMULATED)
        assert marked.startswith(" SIMULATED  Ford Granada · 2026-11-21 · op. MK")
        assert len(marked) == 119


async def test_the_top_line_of_a_wide_terminal_has_losses_and_whole_names() -> None:
    line = TopLine(ASCII)
    async with alone(line, 120, 3) as _:
        bus = BusStatus("socketcan can1", BusState.OK, 0.384, 4e3, 10, 0, 0)
        line.show(replace(STATUS, buses=(bus,)), context())
        (only,) = text(line)
        assert "socketcan can1 * 38%  4/4 alive  lost 0  disk 81 GB" in only
        assert style(line, "lost 0") == ""


async def test_a_top_line_without_room_leaves_out_the_day_then_the_words() -> None:
    line = TopLine(ASCII)

    async with alone(line, 74, 3) as _:
        line.show(STATUS, context())
        assert text(line)[0].startswith(" Ford Granada · 2026-11-21 · op. MK")
        line.show(replace(STATUS, origin=Origin.REPLAYED), context())
        assert text(line)[0].startswith(" REPLAYED  Ford Granada · op. MK")
        line.show(replace(STATUS, vehicle="x" * 30), context())
        assert text(line)[0].startswith(" xxxxx")
        assert "2026" not in text(line)[0]


async def test_a_top_line_without_a_recorder_says_what_to_press() -> None:
    line = TopLine(ASCII)
    async with alone(line, 100, 3) as _:
        line.show(None, context())
        assert text(line) == [" BUMP  waiting for the recorder"]
        line.show(STATUS, context(lost=STARTING))
        assert text(line) == [" STARTING  the recorder is being started"]
        line.show(STATUS, context(lost=Lost("it has ended", "see its log")))
        assert text(line) == [" RECORDER LOST: X = start it again  it has ended"]


async def test_the_steps_are_marked_as_done_here_or_to_come() -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    bar = StepBar(ASCII)
    async with alone(bar, 100, 24) as _:
        bar.show(recorder.status, BenchStep.BASELINE)
        steps = "+ 1 Vehicle + 2 Check [3 Baseline]   4 Masses   5 Added   6 Identify   7 Report"
        assert [shown.rstrip() for shown in text(bar)] == [steps]
        styles = {"2 Check": "bold $success", "[3 Baseline]": "bold reverse"}
        assert {words: style(bar, words) for words in styles} == styles
        bar.show(recorder.status, None)
        assert text(bar)[0].startswith("+ 1 Vehicle + 2 Check   3 Baseline   4 Masses")
        assert style(bar, "3 Baseline") == "bold", "it is reached"
        assert style(bar, "4 Masses") == "$foreground"
        bar.show(None, BenchStep.VEHICLE)
        assert text(bar)[0].startswith("[1 Vehicle]   2 Check")
