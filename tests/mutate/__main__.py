"""Tries mutants against the tests of their rooms: `python -m tests.mutate --count 200 PATH ..`."""

from __future__ import annotations

import argparse
import os
from collections import Counter
from pathlib import Path

from .campaign import Campaign, Outcome
from .draw import draw
from .sources import sources

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def main() -> None:
    """Draw mutants, try each, and print the rate of each room and the survivors."""
    parser = argparse.ArgumentParser(prog="tests.mutate", description=__doc__)
    parser.add_argument("paths", nargs="*", help="files and folders; default: changed since main")
    parser.add_argument("--count", type=int, default=200, help="mutants to draw")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[2])
    given = parser.parse_args()
    root = given.root.resolve()
    paths = sources(root, given.paths)
    campaign = Campaign(root, given.jobs, _show)
    outcomes: list[Outcome] = []
    try:
        drawn = draw(campaign.source, paths, given.count, given.seed)
        for outcome in campaign.outcomes(drawn):
            outcomes.append(outcome)
            _show(f"{len(outcomes)}/{len(drawn)} {_line(campaign.source, outcome)}")
        print(*_rates(outcomes), *_survivors(campaign.source, outcomes), sep="\n")
    finally:
        campaign.close()


def _show(text: str) -> None:
    print(text, flush=True)


def _line(root: Path, outcome: Outcome) -> str:
    mutant = outcome.mutant
    end = "killed  " if outcome.killed else "SURVIVED"
    change = mutant.change((root / mutant.path).read_bytes())[:120]
    place = f"{mutant.path}:{mutant.line}"
    return f"{end} {outcome.seconds:5.1f} s  {place}  {change}  [{outcome.by}]"


def _rates(outcomes: list[Outcome]) -> list[str]:
    drawn = Counter(outcome.mutant.room for outcome in outcomes)
    killed = Counter(outcome.mutant.room for outcome in outcomes if outcome.killed)
    rows = [(room, killed[room], drawn[room]) for room in sorted(drawn)]
    rows.append(("all", killed.total(), drawn.total()))
    width = max(len(room) for room, _, _ in rows)
    seconds = sorted(outcome.seconds for outcome in outcomes)
    middle = f"{seconds[len(seconds) // 2]:.1f} s" if seconds else "none"
    return [
        "",
        *(f"{room:{width}}  {n:4} of {of:4} killed  {n / max(of, 1):4.0%}" for room, n, of in rows),
        f"median time of a mutant: {middle}",
    ]


def _survivors(root: Path, outcomes: list[Outcome]) -> list[str]:
    left = {outcome.mutant: outcome.by for outcome in outcomes if not outcome.killed}
    lines = ["", f"survivors: {len(left)}"]
    for mutant in sorted(left):
        source = (root / mutant.path).read_bytes()
        lines.append(f"{mutant.path}:{mutant.line}  {mutant.change(source)}  [{left[mutant]}]")
        lines.append(f"    {source.decode().splitlines()[mutant.line - 1].strip()}")
    return lines


if __name__ == "__main__":
    main()
