"""The report: the results of a session for people, as HTML, PDF and figures.

`content.report_of` gathers it, `html.html_of` and `pdf.pdf_of` typeset it; both show the same
blocks in the same order.
"""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from ..estimate_text import ends_text as ends_text
    from ..estimate_text import half_percent as half_percent
    from ..estimate_text import half_text as half_text
    from ..estimate_text import value_text as value_text
    from ..numbers import half_width as half_width
    from ..numbers import largest_share as largest_share
    from ..numbers import number as number
    from ..numbers import plus_minus as plus_minus
    from ..numbers import plus_minus_percent as plus_minus_percent
    from ..numbers import rounded as rounded
    from .blocks import Gallery as Gallery
    from .blocks import MovingCars as MovingCars
    from .blocks import Picture as Picture
    from .blocks import Report as Report
    from .blocks import Source as Source
    from .change import unchanged_line as unchanged_line
    from .content import report_of as report_of
    from .dampers import damper_columns as damper_columns
    from .dampers import damper_rows as damper_rows
    from .dampers import element_answer as element_answer
    from .decays import decay_section as decay_section
    from .figures.panels import panel_png as panel_png
    from .figures.panels import panel_svg as panel_svg
    from .html import comparison_html as comparison_html
    from .html import drawings as drawings
    from .html import html_of as html_of
    from .panels import DecayPanel as DecayPanel
    from .panels import ShapePanel as ShapePanel
    from .panels import Trace as Trace
    from .pdf import pdf_of as pdf_of
    from .words import HEADLINE as HEADLINE
    from .words import MEANING as MEANING
    from .words import NOT_OK as NOT_OK
    from .words import SEVERITY as SEVERITY
    from .words import parameter_words as parameter_words
    from .words import plain as plain
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
