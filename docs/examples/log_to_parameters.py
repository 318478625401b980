"""From a log to parameters: `python log_to_parameters.py LOG [BENCH.TOML]`.

The log may be BLF, ASC, TRC, candump, CSV or MF4 (`bumpbench demo` and then `bumpbench export
bumpbench-demo/session_0001.h5 --format blf` make one).  Without a bench.toml the shipped bench is
used.
"""

import sys
from pathlib import Path

import identify
from daq.bench.config import bench_codec, load_bench
from daq.formats.log import Log
from daq.session.from_frames import Intake, labelled, session_from_parts


def main(log: Path, bench_toml: Path | None = None) -> None:
    """Find the bumps, cut the runs, identify, and print what was found."""
    bench = load_bench(bench_toml)
    codec = bench_codec(bench)
    frames, intake = Log([log]), Intake(bench, codec)
    for batch in frames:
        intake.take(batch, frames.hops)
    parts = labelled([intake.part()], bench.campaign.steps, skip=0)
    session = session_from_parts(bench, codec, parts, {"software": "bumpbench"})
    for run in session.runs:
        print(run.label, run.status, *run.reasons)

    result = identify.identify(session)
    print(f"verdict: {result.quality.verdict}", *result.quality.reasons, sep="\n  ")
    for name, e in result.parameters.items():
        print(f"{name:5} {e.value:10.5g} {e.unit:6}  95 %: {e.low:.5g} .. {e.high:.5g}")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*map(Path, sys.argv[1:]))
