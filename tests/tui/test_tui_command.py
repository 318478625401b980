"""`bumpbench tui` up to its first screen, its server for browsers, and `bumpbench status`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from daq.bench.campaign import Origin
from daq.bench.config import default_bench_text
from daq.control.exchange import OrderRefusedError, RecorderGoneError
from daq.control.messages import AskStatus, Order, Reply, Setup, Status
from dbc.words import InputError
from tui.browser import server
from tui.cli import run
from tui.display.link import Served
from tui.terminal.feed import RecorderFeed

from ..daq.a_status import a_status
from .conftest import answered

# The terminal -------------------------------------------------------------------------------------


class Opened:
    """The command without a terminal: what it opens is only noted."""

    def __init__(self) -> None:
        self.apps: list[tuple[tuple[Any, ...], dict[str, Any]]] = []
        self.displays: list[tuple[Any, ...]] = []
        self.attached: list[Path] = []
        self.ran = 0
        self.return_code: int | None = None
        self.served: Served | None = None

    def __call__(self, *arguments: Any, **options: Any) -> Opened:
        self.apps.append((arguments, options))
        return self

    def run(self) -> None:
        """Show nothing."""
        assert len(self.attached) == len(self.apps), "a recorder is there before the screen"
        self.ran += 1

    @contextmanager
    def beside(self, *arguments: Any) -> Iterator[Served | None]:
        """Serve no display."""
        self.displays.append(arguments)
        yield self.served


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Opened:
    made = Opened()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TEXTUAL_DRIVER", "of the test")
    monkeypatch.setenv("USER", "anna")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr(RecorderFeed, "attach", lambda feed: made.attached.append(feed._folder))
    monkeypatch.setattr("tui.terminal.app.BenchApp", made)
    monkeypatch.setattr("tui.display.link.display_beside", made.beside)
    return made


def test_the_terminal_is_opened_in_the_folder_of_its_kind(opened: Opened, tmp_path: Path) -> None:
    (tmp_path / "car.h5").touch()
    assert run(["tui"]) == 0
    assert run(["tui", "--demo"]) == 0
    assert run(["tui", "--replay", "car.h5"]) == 0
    assert run(["tui", "--demo", "--out", "here"]) == 0
    folders = [Path(), Path("bumpbench-demo"), Path("bumpbench-replay"), Path("here")]
    assert opened.attached == folders
    assert [arguments[1] for arguments, _ in opened.apps] == folders
    assert [options["wanted"].origin for _, options in opened.apps] == [
        Origin.REAL, Origin.SIMULATED, Origin.REPLAYED, Origin.SIMULATED,
    ]  # fmt: skip
    assert opened.ran == 4


def test_the_terminal_has_what_its_options_say(opened: Opened) -> None:
    words = ["--glyphs", "blocks", "--theme", "bench-light", "--auto", "--operator", "MK"]
    shown = ["--display", "lan", "--display-control"]
    opened.return_code = 3
    opened.served = Served("x", "127.0.0.1", "")
    assert run(["tui", *words, *shown, "--out", "day"]) == 3
    ((feed, folder, glyphs, name, theme, auto), options) = opened.apps[0]
    assert (folder, glyphs.name, name) == (Path("day"), "blocks", "MK")
    assert (theme, auto) == ("bench-light", True)
    assert options["wanted"] == Setup(Origin.REAL)
    assert (feed._folder, feed._name) == (Path("day"), "MK")
    assert opened.displays == [(Path("day"), "lan", "MK", True)]
    assert options["display"].lines == ("display: open x",)


def test_who_is_not_named_is_the_user_to_the_recorder_and_asked_on_the_screen(
    opened: Opened,
) -> None:
    assert run(["tui"]) == 0
    ((feed, _, _, name, _, _), options) = opened.apps[0]
    assert (feed._name, name) == ("anna", "")
    assert opened.displays == [(Path(), None, "", False)]
    assert options["display"] is None
    assert run(["tui", "--demo"]) == 0
    ((feed, _, _, name, _, _), _) = opened.apps[1]
    assert (feed._name, name) == ("demo", "demo")


def test_the_terminal_starts_the_recorder_that_was_asked_for(
    opened: Opened, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[Any, ...]] = []
    monkeypatch.setattr(
        "tui.recorders.process.start_recorder", lambda *words: started.append(words)
    )
    (tmp_path / "b.toml").write_text(default_bench_text())
    (tmp_path / "car.h5").touch()
    bus = ["--interface", "udp_multicast", "--channel", "239.74.163.9"]
    for words in (
        ["b.toml", *bus],
        ["b.toml", "--demo", "--fault", "unplug", "--speed", "3"],
        ["--replay", "car.h5", "--speed", "2"],
    ):
        assert run(["tui", *words]) == 0
        feed = opened.apps[-1][0][0]
        feed._start_recorder()
    real, simulated, replayed = (options["wanted"] for _, options in opened.apps)
    assert real.bench_crc32 == simulated.bench_crc32 is not None
    assert replayed == Setup(Origin.REPLAYED), "what is not named may be anything"
    assert started == [
        (Path(), "--idle", "b.toml", *bus, "--speed", "1"),
        (Path("bumpbench-demo"), "--idle", "b.toml", "--demo", "--fault", "unplug", "--speed", "3"),
        (Path("bumpbench-replay"), "--replay", "car.h5", "--speed", "2"),
    ]
    assert run(["tui", "b.toml", *bus]) == 0
    (tmp_path / "b.toml").write_text("[bus]\nspeed = 1\n")
    with pytest.raises(InputError, match=r"b\.toml: unknown key bus\.speed"):
        opened.apps[-1][0][0]._start_recorder()
    assert len(started) == 3


# Browsers -----------------------------------------------------------------------------------------


def test_a_browser_gets_the_same_command_if_a_port_is_free(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served: list[Sequence[str]] = []
    monkeypatch.setattr(sys, "argv", ["bumpbench", "tui", "--web", "--out", "my day", "--demo"])
    with monkeypatch.context() as patch:
        patch.setattr(server, "serve", served.append)
        assert run(["tui", "--web", "--demo"]) == 0
    assert served == [["tui", "--out", "my day", "--demo"]]
    taken = OSError(98, "Address already in use")
    monkeypatch.setattr(server, "listen", Mock(side_effect=taken))
    assert run(["tui", "--web", "--demo"]) == 2
    assert "--web: no port of 127.0.0.1 is free" in capsys.readouterr().err


def test_without_its_library_browsers_get_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "textual_serve", None)
    assert run(["tui", "--web"]) == 2
    assert "needs textual_serve, which is not installed" in capsys.readouterr().err


# Status -------------------------------------------------------------------------------------------


class Asked:
    """A recorder that says its status, or nothing yet, or refuses."""

    def __init__(self, says: Status | Exception | None) -> None:
        self.says = says
        self.calls: list[object] = []

    def __call__(self, _: object, name: str, control: bool) -> Asked:
        self.calls.append((name, control))
        return self

    def ask(self, order: Order) -> Reply:
        """Answer."""
        self.calls.append(order)
        if isinstance(self.says, Exception):
            raise self.says
        return Reply(status=self.says)

    def close(self) -> None:
        """Note it."""
        self.calls.append("closed")


def test_the_status_is_printed_in_lines_or_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recorder = Asked(replace(a_status(), vehicle="T5"))
    monkeypatch.setattr("daq.control.exchange.Client", recorder)
    assert run(["status", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("T5, into /var/lib/bumpbench: ")
    assert len(out.splitlines()) > 4
    assert err == ""
    assert recorder.calls == [("status", False), AskStatus(), "closed"]
    document, _ = answered(capsys, "status", str(tmp_path))
    assert (document["vehicle"], document["phase"]) == ("T5", a_status().phase)


@pytest.mark.parametrize(
    ("says", "why"),
    [
        (None, "the recorder has only just started"),
        (OrderRefusedError("not now"), "not now"),
        (RecorderGoneError("here", "it has ended", "start one"), "it has ended"),
    ],
)
def test_a_recorder_without_a_status_is_exit_1(
    says: Exception | None,
    why: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    recorder = Asked(says)
    monkeypatch.setattr("daq.control.exchange.Client", recorder)
    assert run(["status", str(tmp_path)]) == 1
    assert capsys.readouterr() == ("", f"bumpbench: {tmp_path}: {why}\n")
    assert recorder.calls[-1] == "closed"
    assert run(["status", str(tmp_path), "--json"]) == 1
    out, err = capsys.readouterr()
    assert json.loads(out) == {"folder": str(tmp_path), "running": False, "error": why}
    assert why in err
