"""Bad input: one line on stderr, the right exit code, nothing half-written."""

from pathlib import Path

import pytest

from tui.cli import run


def _fails(capsys: pytest.CaptureFixture[str], arguments: list[str], code: int) -> str:
    assert run(arguments) == code
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert len(lines) == 1, err
    assert lines[0].startswith("bumpbench: error: ")
    assert all(c.isprintable() for c in lines[0])
    return lines[0]


@pytest.mark.parametrize("command", [["identify"], ["inspect"], ["decode"]])
def test_no_such_file(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: list[str]
) -> None:
    line = _fails(capsys, [*command, str(tmp_path / "absent.h5")], 2)
    assert "absent.h5" in line


@pytest.mark.parametrize("command", ["identify", "inspect"])
def test_not_a_session(capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str) -> None:
    path = tmp_path / "prose.h5"
    path.write_text("this is no HDF5 file\x1b[31m")
    assert "prose.h5" in _fails(capsys, [command, str(path)], 2)
    assert "is a directory" in _fails(capsys, [command, str(tmp_path)], 2)


def test_not_a_dbc(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    log, dbc = tmp_path / "x.log", tmp_path / "x.dbc"
    log.write_text("(0.0) can0 100#00\n")
    dbc.write_bytes(bytes(range(256)))
    assert "x.dbc" in _fails(capsys, ["decode", str(log), "--dbc", str(dbc)], 2)


def test_a_log_of_another_bus(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    log = tmp_path / "other.log"
    log.write_text("(1.0) can0 7DF#0201050000000000\n(1.1) can0 7E8#0341057B00000000\n")
    assert "none of its 2 frames" in _fails(capsys, ["decode", str(log)], 2)


def test_a_log_of_no_known_format(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    log = tmp_path / "notes.docx"
    log.write_text("x")
    assert ".docx" in _fails(capsys, ["decode", str(log)], 2)


@pytest.mark.parametrize("command", ["record", "simulate"])
def test_unknown_key_in_bench_toml(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, command: str
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text("[campaign]\nrepaets = 3\n[bus]\ninterface = 'udp_multicast'\n")
    line = _fails(capsys, [command, str(bench)], 2)
    assert "campaign.repaets" in line
    assert list(tmp_path.iterdir()) == [bench]


@pytest.mark.parametrize("text", ["[campaign", "campaign = 3", "[trigger]\nlevel = -1", "a = nan"])
def test_broken_bench_toml(capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(text)
    _fails(capsys, ["record", str(bench)], 2)


def test_bench_toml_that_names_no_dbc(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('dbc = "absent.dbc"')
    assert "absent.dbc" in _fails(capsys, ["record", str(bench)], 2)


@pytest.mark.parametrize(
    "bus",
    [
        'interface = "warp_drive"',
        'interface = "slcan"\nchannel = "/dev/no_such_tty"',
        'interface = "socketcan"\nchannel = "can77"',
    ],
)
@pytest.mark.parametrize("command", ["record", "simulate"])
def test_no_such_bus(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, command: str, bus: str
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(f"[bus]\n{bus}\n")
    out = tmp_path / "out"
    arguments = [command, str(bench), *(["--out", str(out)] if command == "record" else [])]
    _fails(capfd, arguments, 4)  # the recorder's log goes to the descriptor itself
    assert not out.exists()


@pytest.mark.parametrize(
    "arguments", [["identfy"], ["identify"], ["demo", "--seed", "x"], ["study", "table9"], ["--no"]]
)
def test_mistakes_in_the_command_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    _fails(capsys, arguments, 2)


@pytest.mark.parametrize("command", ["record", "simulate"])
def test_a_bus_that_ends_at_this_process(capsys: pytest.CaptureFixture[str], command: str) -> None:
    assert "udp_multicast" in _fails(capsys, [command], 2)


def test_recover_of_no_journal(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path, out = tmp_path / "prose.mcap", tmp_path / "car.h5"
    path.write_text("no journal")
    assert "prose.mcap" in _fails(capsys, ["recover", str(path), "--out", str(out)], 2)
    assert not out.exists()


def test_a_bad_option_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--seed" in _fails(capsys, ["demo", "--seed", "-3"], 2)


@pytest.mark.parametrize("arguments", [[], ["study"]])
def test_saying_nothing_asks_for_help(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(arguments) == 0
    assert "Usage: bumpbench" in capsys.readouterr().out


def test_help_is_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    out, err = capsys.readouterr()
    assert "identify" in out
    assert err == ""


def test_a_folder_that_may_not_be_entered_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    closed = tmp_path / "private"

    def denied(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_dir", denied)
    line = _fails(capsys, ["recover", str(closed / "today")], 2)
    assert "private/today: access is denied" in line


def test_a_display_of_no_folder_does_not_wait(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert "does not exist" in _fails(capsys, ["display", str(tmp_path / "absent")], 2)
    path = tmp_path / "bench.toml"
    path.touch()
    assert "is not a folder" in _fails(capsys, ["display", str(path)], 2)
