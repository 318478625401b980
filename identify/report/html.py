"""The report as one HTML file: inline SVG and CSS, nothing fetched, no script."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future
from importlib.resources import files
from types import MappingProxyType

import jinja2
from markupsafe import Markup, escape

from daq.documents import json_in_html

from ..compare import Comparison
from ..fit.estimation import Estimation
from ..trust.finding import Verdict
from ..words import HEADLINE, MEANING, SEVERITY, SYMBOL, plain, survival_lines
from .cars import moving_car
from .comparison import comparison_sections
from .figure import svg_of
from .page import Picture, Report

_WIDE = 9
"""Columns beyond which a table is set small."""
_MANY = 12
"""Pictures of a gallery beyond which it is folded."""
_PX_AN_INCH = 100.0
"""Least width of a picture, CSS pixels per inch: its smallest text, 6.5 points, then has 9
pixels."""


def drawings(pictures: Iterable[Picture], executor: Executor) -> dict[str, Future[Markup]]:
    """Start to draw pictures for `html_of`; return the future drawing of each by its key."""
    return {picture.key: executor.submit(drawing, picture) for picture in pictures}


def html_of(report: Report, begun: Mapping[str, Future[Markup]] = MappingProxyType({})) -> str:
    """Typeset a report as HTML, with the document of its result as data.

    `begun`: pictures that are drawn elsewhere (`drawings`).
    """
    return _page(
        "report.jinja",
        {"identification": report.result.document(report.source.sha256)},
        drawing=lambda p: begun[p.key].result() if p.key in begun else drawing(p),
        sections=report.sections,
        report=report,
        quality=report.result.quality,
        created=report.result.provenance.get("created", ""),
        survival=survival_lines(report.result.quality),
        symbol=SYMBOL,
        verdict_of=Verdict.of,
        headline=HEADLINE,
        meaning=MEANING,
        severity=SEVERITY,
        plain=plain,
    )


def comparison_html(comparison: Comparison, estimations: Sequence[Estimation] = ()) -> str:
    """Typeset a comparison of sessions, with its JSON document as data, as HTML.

    `estimations`: their fits, whose decays are overlaid.
    """
    rows = comparison.quantities
    return _page(
        "comparison.jinja",
        {"comparison": comparison.document()},
        drawing=drawing,
        sections=comparison_sections(comparison, estimations),
        comparison=comparison,
        differing=[row.name for row in rows if any(d.significant for d in row.differences)],
        drifting=[row.name for row in rows if row.trend is not None and row.trend.drifts],
    )


def _page(name: str, documents: Mapping[str, Mapping[str, object]], **content: object) -> str:
    room = files(__package__)
    environment = jinja2.Environment(
        autoescape=True,
        loader=jinja2.FunctionLoader(lambda name: (room / name).read_text("utf-8")),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name).render(
        css=Markup((room / "report.css").read_text("utf-8")),
        documents={key: Markup(json_in_html(d, indent=1)) for key, d in documents.items()},
        kind=lambda block: type(block).__name__,
        moving=moving_car,
        wide=_WIDE,
        many=_MANY,
        **content,
    )


def drawing(picture: Picture) -> Markup:
    """Draw a picture for a page with others: no prologue, no global style, its own ids."""
    svg = svg_of(picture)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    named = f"role='img' aria-label='{escape(picture.title)}'"
    least = f"style='min-width:{picture.width_in * _PX_AN_INCH:.0f}px'"
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', lambda m: f"{m[1]} {named} {least}", svg, count=1)
    svg = re.sub(r'<g id="[^"]*">', "<g>", svg)
    key = re.sub(r"\W", "_", picture.key)
    svg = re.sub(r'((?: id="|href="#|url\(#))', rf"\g<1>{key}_", svg)
    svg = svg.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif")
    svg = re.sub(r"\n\s*", "\n", svg)
    return Markup(svg)
