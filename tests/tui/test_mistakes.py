"""One line for each mistake, one way to name things, and how a command ends."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import h5py
import numpy as np
import pytest
import typer
from filelock import FileLock
from typer.core import TyperGroup
from typer.main import get_command

import daq
from daq import write_session
from daq.bench.config import default_bench_text
from daq.bus.source import BusError
from daq.control.address import FolderLockedError
from dbc.words import InputError
from tui.cli import app, run

from ..daq.small_campaign import bumps, small_codec
from ..daq.small_session import small_session
from .batches import refused_session, write_all
from .conftest import answered
from .test_import import BENCH, CUT, MAP, write_drive, write_log

Said = Callable[..., str]
FRAME = "(1436509052.249713) can0 100#0011223344556677\n"
MESSAGE = 'VERSION ""\nBU_: A\nBO_ 256 M: 8 A\n SG_ x : {signal} "m/s2" A\n'
SIGNAL = "0|16@1- (0.1,0) [0|0]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a session, a log and its bench, which no mistake may change."""
    folder = tmp_path_factory.mktemp("bench")
    daq.write_session(folder / "car.h5", small_session())
    (folder / "bench.toml").write_text(BENCH)
    write_log(folder / "all.log", bumps(small_codec(), 4))
    (folder / "other.log").write_text("(1.0) can0 7DF#02\n(1.1) can0 7E8#03\n(1.2) can1 7E8#03\n")
    write_log(folder / "still.log", bumps(small_codec(), 1).select(slice(0, 400)))
    (write_drive(folder) / "cut.toml").write_text(f"[[run]]\n{CUT}{MAP}")
    for name in ("prose.h5", "prose.mcap", "notes.docx"):
        (folder / name).write_text("no session, and no journal\x1b[31m")
    for name in ("odd", "odd.toml"):
        (folder / name).write_text("[bus]\nspeed = 1\n")
    (folder / "figure.svg").mkdir()
    bus = "[bus]\ninterface = "
    for name, text in (
        ("strange", bus + '"warp_drive"'),
        ("serial", bus + '"slcan"\nchannel = "/dev/no_such_tty"'),
        ("absent", bus + '"socketcan"\nchannel = "can77"'),
    ):
        (folder / f"{name}.toml").write_text(text)
    signal = default_bench_text().replace("IMU_Accel.acc_z", "IMU_Accel.acc_zz")
    (folder / "signal.toml").write_text(signal, "utf-8")
    counter = '\n[[message]]\nname = "IMU_Accel"\ncounter = "nope"\n'
    (folder / "counter.toml").write_text(default_bench_text() + counter, "utf-8")
    return folder


@pytest.fixture
def said(capfd: pytest.CaptureFixture[str]) -> Said:
    """Run a command with a mistake and return the one line that it says."""

    def line(words: list[str], code: int = 2) -> str:
        assert run(words) == code
        out, err = capfd.readouterr()  # the recorder's log goes to the descriptor itself
        lines = [line for line in err.splitlines() if not line.startswith("bumpbench: left out:")]
        assert out == ""
        assert len(lines) == 1, err
        assert lines[0].startswith("bumpbench: error: ")
        assert lines[0].endswith(")")  # what to do
        assert all(c.isprintable() for c in lines[0])
        return lines[0]

    return line


MISTAKES = {
    # the command line itself
    "identfy": "identify",
    "recrod": "(bumpbench --help lists what there is)",
    "identify": "bumpbench identify --help",
    "demo --seed -3": "--seed",
    "tui --demoo": ": --demoo (Possible options: --demo) (bumpbench tui --help lists",
    "tui --speed fast": "'--speed': Input should be a valid number",
    "tui --demo --fault double-bum": "double-bump",
    "tui --fault unplug": "add --demo",
    "tui --demo --replay car.h5": "cannot be combined with --replay",
    "tui --replay absent.h5": "absent.h5: is not a file",
    "tui --interface virtual --channel x": "does not reach other processes",
    "tui --demo --out new": "is not a terminal",
    "tui odd.toml": "odd.toml: unknown key bus.speed",
    "tui --demo odd.toml": "odd.toml: unknown key bus.speed",
    "tui --web odd.toml": "odd.toml: unknown key bus.speed",
    "export car.h5 --format mf5": "is not one of 'mf4', 'mat'",
    "study tabel2": "(bumpbench study --help lists what there is)",
    # files
    "identify absent.h5": "error: absent.h5: no such file (name a session file that",
    "decode absent.h5": "absent.h5",
    "identify prose.h5": "prose.h5",
    "inspect .": "error: .: is a directory (name a session file that",
    "report /": "is a directory",
    "report nowhere/car.h5": "error: nowhere/car.h5: no such file (name a session file",
    "recover prose.mcap --out new.h5": "prose.mcap",
    "recover .": ".: has no journal_*.bbj",
    "recover absent": "absent: there is no such file or folder",
    "decode other.log": "none of its 3 frames",
    "decode notes.docx": ".docx",
    "display absent": "is not a folder",
    "display bench.toml": "is not a folder",
    "validate": "no file is given",
    # words that do not fit together
    "decode all.log bench.toml --dbc x.dbc": "exclude each other",
    "import": "names no file",
    "import --run baseline:roll:all.log --skip 1": "for files of many runs",
    "import --run baseline:roll:all.log --runs baseline:roll": "of many runs",
    "import all.log --run baseline:roll:all.log": "both files and --run",
    "import --run baseline:all.log": "--run",
    "import all.log bench.toml --skip 4": "no bump is left",
    "import all.log bench.toml --runs baseline:jump": "is not a run",
    "import all.log bench.toml --runs loaded:bounce": "not on this bench",
    "import all.log bench.toml --bus 3": "none of its",
    "import other.log bench.toml --bus 1": "none of its 1 frame is in the DBC",
    "import still.log bench.toml": "no bump in 400 frames",
    "import missing.blf bench.toml": "no such file",
    "import drive.csv --channels cut.toml --skip 1": "states the times of its runs",
    "import --run baseline:roll:drive.csv --channels map.toml --skip 1": "of many runs",
    "import drive.csv --channels map.toml --bus 1": "is for files without a bus",
    "import --channels map.toml": "names no file",
    "import drive.csv --channels no.toml": "No such file",
    "import all.log --out all.log/out.h5": "name another folder",
    "check --push 3 all.log": "--push: is for --propose",
    "check --propose new.toml --push 3": "--push: is for a log or a live bus",
    "import all.log bench.toml strange.toml": "is named twice",
    # a bench
    "check signal.toml other.log": "has no signal 'IMU_Accel.acc_zz' (write signal as Message",
    "record --interface socketcan": "--interface socketcan: names no channel (add --channel can0,",
    "plan signal.toml": "signal of channel body_acc_z: ",
    "check counter.toml other.log": "message IMU_Accel: has no signal nope, which counter names (",
    "record": "udp_multicast",
    "simulate": "udp_multicast",
    "plan nosuch.toml": "nosuch.toml: No such file",
    "plan --from absent.h5": "absent.h5: no such file",
    "plan --bump-mm 0": "--bump-mm",
    "plan --bump-mm nan": "--bump-mm",
    "plan --rate nan": "--rate",
    "plan /dev/null": "/dev/null: is not a",
    "check --dbc x.dbc": "is for --propose",
    "check --propose x.toml --layout nosuch": "there is no such layout",
    "check x.toml --layout sbg_ecan": "is for --propose",
    "check absent.blf": "absent.blf: no such file (name a log",
    "check odd": "odd: unknown key bus.speed",
    "check odd.toml": "odd.toml: unknown key bus.speed",
    "check": "virtual",
    "check --bitrate 250000": "--bitrate: is for --propose",
    "check --propose /dev/null/new.toml": "/dev/null: is not a folder",
    # the desk
    "report car.h5 --format png": "is for --figures",
    "report car.h5 --page reprots/r.html": "error: reprots: there is no such folder",
    "report car.h5 --out car.h5": "car.h5: is not a known form of page",
    "report car.h5 --pdf car.h5": "car.h5: is not a known form of printed report",
    "compare car.h5 car.h5 --page car.h5": "car.h5: is not a known form of page",
    "report car.h5 --figures all.log": "'all.log' is a file",
    "compare car.h5": "name two sessions or more",
    "batch no/such/*.h5": "no/such/*.h5",
    "batch figure.svg": "no session file",
    "batch car.h5 --out table.xlsx": "end its name in .csv",
    "batch car.h5 --out car.h5/t.csv": "car.h5: is not a folder",
    "batch car.h5 --workers 0": "--workers",
    "batch car.h5 --workers 2 --scheduler tcp://127.0.0.1:1": "--scheduler",
    "batch car.h5 --scheduler nonsense": "nonsense",
    # export
    "export car.h5": "neither --format nor --out",
    "export car.h5 --out car": "has no suffix",
    "export car.h5 --out x.xls": ".xls is not an export format",
    "export car.h5 --format mat --run warp": "there is no run warp",
    "export car.h5 --format csv --decimal ;": "--decimal",
    "export car.h5 --format mat --decimal ,": "--decimal: mat has none",
    "export car.h5 --out /dev/null/x.mat": "name another folder",
    # study
    "study table2 --response rough": "rough",
    "study fig2 --figure /dev/null/x.svg": "name another folder",
    "study fig2 --figure figure.svg": "is a directory",
    "study fig3 --figure picture.png": "end its name in .svg",
    "study fig9 --rate-hz nan": "nan Hz",
    "study noise --cases bounce,wrap": "wrap",
    "study noise --cases ,": "cases",
    "study noise --cases roll,roll": "twice",
    "study noise --noise-db inf": "inf dB",
    "study noise --rate-hz 1e9": "1e+09 Hz",
    "study noise --workers 0": "--workers",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_is_one_line(
    words: str, folder: Path, said: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)

    def contents() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}

    before = contents()
    assert MISTAKES[words] in said(words.split())
    assert contents() == before


@pytest.mark.parametrize(
    ("command", "bench"),
    [
        ("record --out out", "strange"),
        ("record --out out", "serial"),
        ("record --out out", "absent"),
        ("simulate", "serial"),
        ("check --seconds 0.1", "serial"),
    ],
)
def test_no_such_bus_is_exit_4(
    bench: str, command: str, folder: Path, said: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    said([*command.split(), f"{bench}.toml"], 4)


def test_a_folder_that_may_not_be_entered(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: Said
) -> None:
    def denied(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_dir", denied)
    line = said(["recover", str(tmp_path / "private" / "today")])
    assert "private/today: Permission denied" in line


DBC: dict[str, bytes] = {
    "empty": b"",
    "NULs": b"\0" * 1000,
    "UTF-16": (MESSAGE.format(signal=SIGNAL)).encode("utf-16"),
    "binary": bytes(range(256)) * 20,
    "XML": b'<?xml version="1.0"?><a><b/></a>',
    "prose": b"Dear colleague, here is the database you asked for.\n" * 20,
    "truncated": MESSAGE.format(signal=SIGNAL).encode()[:45],
    "outside the message": MESSAGE.format(signal="60|16@1- (0.1,0) [0|0]").encode(),
    "length 0": MESSAGE.format(signal="0|0@1- (0.1,0) [0|0]").encode(),
    "length 10^6": MESSAGE.format(signal="0|1000000@1- (0.1,0) [0|0]").encode(),
    "factor 0": MESSAGE.format(signal="0|16@1- (0,0) [0|0]").encode(),
    "factor inf": MESSAGE.format(signal="0|16@1- (1e400,0) [0|0]").encode(),
    "standard id above 11 bits": MESSAGE.format(signal=SIGNAL).replace("256", "4096").encode(),
    "duplicate id": (
        MESSAGE.format(signal=SIGNAL) + f'\nBO_ 256 N: 8 A\n SG_ y : {SIGNAL} "m/s2" A\n'
    ).encode(),
    "too large": b"CM_ " + b"x" * 6_000_000,
}
BAD_BENCH: dict[str, bytes] = {
    "bad UTF-8": b'[vehicle]\nname = "\xff\xfe"\n',
    "duplicate key": b"[campaign]\nrepeats = 1\nrepeats = 2\n",
    "unterminated": b'[vehicle]\nname = "Granada\n',
    "no table": b"campaign = 3\n",
    "deep": b"a = " + b"[" * 5000,
    "big integer": b"[campaign]\nrepeats = " + b"9" * 5000,
    "unknown key": b"[campaign]\nrepaets = 1\n",
    "wrong type": b'[campaign]\nrepeats = "two"\n',
    "negative": b"[trigger]\npre_s = -1.0\n",
    "nan": b"[trigger]\nlevel = nan\n",
    "no such DBC": b'dbc = "nowhere/absent.dbc"\n',
    "unknown fact": b'[[fact]]\nquantity = "colour"\nvalue = 1.0\nsigma = 1.0\n',
    "fact without sigma": b'[[fact]]\nquantity = "total_mass_kg"\nvalue = 1.0\nsigma = 0.0\n',
    "too large": b"# " + b"x" * 1_100_000,
}


@pytest.mark.parametrize("case", DBC)
def test_dbc(case: str, said: Said, tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(FRAME)
    (tmp_path / "bad.dbc").write_bytes(DBC[case])
    words = ["decode", str(tmp_path / "bus.log"), "--dbc", str(tmp_path / "bad.dbc")]
    assert "bad.dbc" in said(words)


@pytest.mark.parametrize("case", BAD_BENCH)
def test_bench(case: str, said: Said, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_bytes(BAD_BENCH[case])
    for command in ("plan", "record"):
        line = said([command, str(tmp_path / "bad.toml")])
        assert ("absent.dbc" if case == "no such DBC" else "bad.toml") in line
    assert ("campaign.repaets" in line) == (case == "unknown key")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def _foreign(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["data"] = np.arange(3)


def _newer(path: Path, version: int = 99) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "bumpbench-session"
        file.attrs["schema_version"] = version


def _linked(path: Path) -> None:
    _newer(path, 1)
    with h5py.File(path, "a") as file:
        file["session"] = h5py.ExternalLink("/etc/hostname", "/")


def _huge(path: Path) -> None:
    _newer(path, 1)
    with h5py.File(path, "a") as file:
        file.create_dataset("channels/name", shape=(2**40,), dtype="S64", chunks=(1024,))


@pytest.mark.parametrize(
    ("command", "make"),
    [
        *(("inspect", make) for make in (Path.touch, Path.mkdir, _foreign, _newer, _linked, _huge)),
        ("identify", _huge),
        ("report", _linked),
        ("export --format mat", _foreign),
    ],
)
def test_session(make: Callable[[Path], None], command: str, said: Said, tmp_path: Path) -> None:
    make(tmp_path / "bad.h5")
    assert "bad.h5" in said([*command.split(), str(tmp_path / "bad.h5")])


@pytest.mark.parametrize(
    "command", ["import a.log", "check a.toml", "record a.toml", "plan a.toml"]
)
def test_a_fifo_is_named_and_never_opened(
    command: str, said: Said, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Opening one waits until something is written to it."""
    monkeypatch.chdir(tmp_path)
    words = command.split()
    os.mkfifo(fifo := tmp_path / words[1])
    writer = Thread(target=lambda: fifo.write_bytes(b"# a bench\n"), daemon=True)
    writer.start()
    assert f"{words[1]}: is not a regular file" in said(words)
    assert writer.is_alive(), "a reader came"
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    writer.join()
    os.close(reader)


# Files that are there -----------------------------------------------------------------------------


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a session, a log and its bench."""
    monkeypatch.chdir(tmp_path)
    daq.write_session(tmp_path / "car.h5", small_session())
    (tmp_path / "bench.toml").write_text(BENCH)
    write_log(tmp_path / "all.log", bumps(small_codec(), 4))
    assert run(["import", "all.log", "bench.toml", "--out", "imported.h5"]) == 0
    return tmp_path


WRITERS = [
    ("session.h5", ["import", "all.log", "bench.toml"], 0),
    ("again.h5", ["redecode", "imported.h5", "bench.toml", "--out", "again.h5"], 0),
    ("imported_redecoded.h5", ["redecode", "imported.h5", "bench.toml"], 0),
    ("car.mat", ["export", "car.h5", "--format", "mat"], 0),
    ("bump_test.ipynb", ["notebook"], 0),
    ("new.toml", ["check", "bench.toml", "--propose", "new.toml"], 0),
    ("rows.csv", ["batch", "car.h5", "--workers", "1", "--out", "rows.csv"], 1),
]


@pytest.mark.parametrize(("name", "words", "code"), WRITERS)
def test_an_existing_file_is_replaced_after_a_word_alone(
    workplace: Path, name: str, words: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    (there := workplace / name).write_text("measured by hand")
    capsys.readouterr()
    assert run(words) == 2
    out, err = capsys.readouterr()
    option = "--propose" if name == "new.toml" else "--out"
    advice = f"name another file with {option}, or use --force"
    assert (out, err) == ("", f"bumpbench: error: {name}: exists already ({advice})\n")
    assert there.read_text() == "measured by hand"
    assert run([*words, "--force"]) == code
    assert there.read_bytes() != b"measured by hand"


@pytest.mark.parametrize(
    ("words", "target"),
    [
        (["import", "all.log", "bench.toml", "--out", "all.log"], "all.log"),
        (["import", "--run", "baseline:roll:all.log", "--out", "all.log"], "all.log"),
        (["redecode", "imported.h5", "bench.toml", "--out", "imported.h5"], "imported.h5"),
        (["redecode", "imported.h5", "bench.toml", "--out", "bench.toml"], "bench.toml"),
        (["export", "car.h5", "--format", "mat", "--out", "car.h5"], "car.h5"),
        (["check", "bench.toml", "--propose", "bench.toml"], "bench.toml"),
        (["check", "bench.toml", "all.log", "--propose", "all.log"], "all.log"),
    ],
)
def test_no_word_lets_a_command_replace_what_it_reads(
    workplace: Path, words: list[str], target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (workplace / target).read_bytes()
    capsys.readouterr()
    assert run([*words, "--force"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"bumpbench: error: {target}: is read here (name another file with --")
    assert err.count("\n") == 1
    assert (workplace / target).read_bytes() == before


def test_version_and_short_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.split()[0] == "bumpbench"
    assert run(["-h"]) == 0
    whole = capsys.readouterr().out
    assert "At the bench" in whole
    assert run(["status", "-h"]) == 0
    assert "The recorder's folder" in capsys.readouterr().out


def test_a_reader_of_stdout_that_has_gone_is_no_refusal() -> None:
    """`bumpbench ... | head -1` under pipefail."""
    script = "from tui.cli import run; raise SystemExit(run(['simulate', '--help']))"
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 0


def test_status_says_why_there_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["status", str(tmp_path / "absent")]) == 1
    assert "absent: there is no such folder" in capsys.readouterr().err
    assert run(["status", str(tmp_path)]) == 1
    assert list(tmp_path.iterdir()) == [], "who asks leaves nothing"
    with FileLock(tmp_path / "recorder.lock"):
        assert run(["status", str(tmp_path)]) == 1
    said = "a recorder writes there, but does not answer here"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["study"]])
def test_saying_nothing_asks_for_help(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(arguments) == 0
    assert "Usage: bumpbench" in capsys.readouterr().out


def test_help_of_every_command_is_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    top = get_command(app)
    assert isinstance(top, TyperGroup)
    names = [[name] for name in top.commands if name != "study"]
    for words in ([], *names, ["study", "noise"]):
        assert run([*words, "--help"]) == 0
        out, err = capsys.readouterr()
        assert out.startswith("Usage: bumpbench")
        assert err == ""


def test_an_identification_that_is_refused_says_so_first(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (file,) = write_all(tmp_path, refused_session, 1)
    assert run(["identify", str(file)]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines()[0] == "verdict: refused", "without a fit there is no chi2"
    assert err == ""
    document, _ = answered(capsys, "identify", str(file), code=1)
    assert document["verdict"] == "refused"
    assert "added mass" in document["reasons"][0]
    assert (document["parameters"], document["chi2_per_n"]) == ({}, None)


# Exit codes and lines of errors -------------------------------------------------------------------


def ends(error: BaseException | None, code: int | None = None) -> int:
    """Return the exit code of a command that raises an error, or returns a code."""
    commands = typer.Typer()

    @commands.command()
    def one() -> int | None:
        """Do it."""
        if error is not None:
            raise error
        return code

    @commands.command()
    def other() -> None:
        """Do nothing."""

    return run(["one"], commands)


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (None, 0, ""),
        (InputError("a.h5", "is damaged", "build it"), 2, "a.h5: is damaged (build it)"),
        (BusError("can0", "is not there", "plug it in"), 4, "can0: is not there"),
        (FolderLockedError("x", "is locked", "end it"), 75, "x: is locked"),
        (KeyboardInterrupt(), 130, ""),
        (typer.Abort(), 130, ""),
        (typer.BadParameter("name two sessions"), 2, "name two sessions (bumpbench one --help"),
        (PermissionError(13, "Permission denied", "/root/x"), 2, "/root/x: Permission denied"),
        (OSError(36, "File name too long", b"x/y"), 2, "x/y: File name too long (name another"),
    ],
)
def test_each_kind_of_error_has_its_exit_code(
    error: BaseException | None, code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends(error) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert len(err.splitlines()) == bool(said)


# Signals and closed streams -----------------------------------------------------------------------


def test_an_export_that_is_ended_leaves_nothing_behind(tmp_path: Path) -> None:
    """A real process, ended as soon as it writes: the temporary file is large enough to be seen."""
    (tmp_path / "out").mkdir()
    words = [str(tmp_path / "car.h5"), "--out", str(tmp_path / "out" / "car.csv")]
    write_session(tmp_path / "car.h5", small_session())
    done = subprocess.run(
        [sys.executable, "-c", _ENDED, "export", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "")
    assert list((tmp_path / "out").iterdir()) == []


_ENDED = """
import os, sys
from daq.formats import export
from tui.__main__ import main
write = export.write_csv

def ended(group, units, path, style):
    write(group, units, path, style)
    os.kill(os.getpid(), 15)

export.write_csv = ended
sys.argv = ["bumpbench", *sys.argv[1:]]
main()
"""


def test_a_stdout_without_room_is_named_in_one_line() -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "tui", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (
        2,
        "bumpbench: error: stdout: No space left on device (make room, or write to another "
        "place)\n",
    )


def test_an_error_of_another_file_is_not_taken_for_one_of_stdout(
    capsys: pytest.CaptureFixture[str],
) -> None:
    commands = typer.Typer()

    @commands.command()
    def fails() -> None:
        raise OSError(5, "Input/output error")

    with pytest.raises(OSError, match="Input"):
        run([], commands)
    assert "stdout" not in capsys.readouterr().err
