"""Terminals and recorders that are killed in mid-run, and two terminals at once."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

from daq.control.messages import Hello, Pause, Phase
from daq.runs import RunStatus
from tui.terminal.feed import Lost, News, RecorderFeed, Role

from .bench_terminal import PATIENCE_S, DemoBench, PtyTerminal, demo_bench, seat, terminal_on

ATTACHED_S = 2.0
SPEED = 2.0


async def kill_the_terminal_in_mid_decay(bench: DemoBench) -> None:
    terminal = PtyTerminal("--demo", "--out", str(bench.folder), "--auto", "--operator", "MK")
    terminal.until(b"DECAY")
    during = bench.wait(lambda status: status.phase is Phase.DECAY)
    terminal.kill()
    killed_s = time.monotonic()
    app = terminal_on(bench.folder)
    async with seat(app) as operator:
        await operator.until(lambda: app.in_control and app.status is not None)
        assert time.monotonic() - killed_s < 2 * ATTACHED_S  # 2 s on a machine of its own
        await operator.until(lambda: app.screen.has_class("-run"))
        label = during.runs[-1].label  # of the first bump, or on a busy machine a later one
        await operator.until(
            lambda: bool(
                app.status
                and any(
                    run.label == label and run.status is RunStatus.ACCEPTED
                    for run in app.status.runs
                )
            )
        )


async def kill_the_recorder_in_mid_run(bench: DemoBench) -> None:
    app = terminal_on(bench.folder, bench.start)
    async with seat(app) as operator:
        await operator.until(lambda: app.in_control and app.status is not None)
        await operator.until(
            lambda: bool(app.status and app.status.phase is Phase.DECAY), operator.space_if_offered
        )
        assert app.status is not None
        cut = app.status.runs[-1]
        accepted = [run.label for run in app.status.runs if run.status is RunStatus.ACCEPTED]
        assert accepted
        assert cut.status is RunStatus.OPEN
        bench.kill()
        await operator.until(operator.sees("RECORDER LOST"))
        assert "X = start it again" in operator.text
        await operator.pilot.press("x")
        await operator.until(lambda: app.lost is None and "RECORDER LOST" not in operator.text)
        assert app.status is not None
        after = {run.label: run for run in app.status.runs}
        assert [after[label].status for label in accepted] == [RunStatus.ACCEPTED] * len(accepted)
        assert after[cut.label].status is RunStatus.REJECTED
        assert "cut" in " ".join(after[cut.label].reasons)
        assert app.in_control
        before = len(app.status.runs)
        await operator.until(
            lambda: bool(app.status and len(app.status.runs) > before), operator.space_if_offered
        )


async def two_terminals(bench: DemoBench) -> None:
    first, second = terminal_on(bench.folder), terminal_on(bench.folder)
    async with seat(first) as one:
        await one.until(lambda: first.in_control and first.status is not None)
        async with seat(second) as two:
            await two.until(two.sees("VIEWER"))
            assert await second.ask(Pause()) is None, "who looks on gives no orders"
            await two.pilot.press("c")
            await two.until(lambda: second.in_control and "op. MK" in two.text)
            await one.until(one.sees("VIEWER"))


def test_terminal_killed_recorder_killed_and_two_terminals(tmp_path: Path) -> None:
    with demo_bench(tmp_path, SPEED, 3) as bench:
        bench.started()
        bench.skip_to_bumps()
        asyncio.run(kill_the_terminal_in_mid_decay(bench))
        asyncio.run(kill_the_recorder_in_mid_run(bench))
        asyncio.run(two_terminals(bench))


def test_the_name_said_last_holds_after_every_connection(tmp_path: Path) -> None:
    news: list[News] = []

    def news_of(kind: type[News]) -> int:
        return sum(isinstance(n, kind) for n in news)

    def wait_for(kind: type[News], count: int) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while news_of(kind) < count:
            assert time.monotonic() < deadline_s, news
            time.sleep(0.02)

    with demo_bench(tmp_path, 1.0) as bench:
        bench.started()
        feed = RecorderFeed(bench.folder, "somebody", bench.start)
        feed.start(news.append)
        try:
            wait_for(Role, 1)
            asyncio.run(feed.ask(Hello("Anna", control=True)))
            bench.wait(lambda status: status.controller == "Anna")
            feed.take_over()  # connects anew
            wait_for(Role, 2)
            bench.wait(lambda status: status.controller == "Anna")
            bench.kill()
            wait_for(Lost, 1)
            feed.restart()
            wait_for(Role, 3)
            bench.wait(lambda status: status.controller == "Anna")
        finally:
            feed.stop()
