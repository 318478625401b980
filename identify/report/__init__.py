"""The report: the results of a session for people, as HTML, PDF and figures.

`report_of` gathers it, `html_of` and `pdf_of` typeset it; both show the same blocks in the same
order.
"""

from .cars import still_cars
from .content import report_of
from .decays import decay_section, decay_traces
from .evidence import CrossChecks, cross_checks
from .page import MovingCars, Picture, Report, Source, png_of, svg_of
from .typeset import comparison_html, drawings, html_of, pdf_of

__all__ = [
    "CrossChecks",
    "MovingCars",
    "Picture",
    "Report",
    "Source",
    "comparison_html",
    "cross_checks",
    "decay_section",
    "decay_traces",
    "drawings",
    "html_of",
    "pdf_of",
    "png_of",
    "report_of",
    "still_cars",
    "svg_of",
]
