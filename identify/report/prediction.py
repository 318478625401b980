"""Section on runs that are left out one by one and predicted from the others."""

from __future__ import annotations

import numpy as np

from dbc.words import counted

from ..fit.cross_validation import Prediction
from .blocks import Block, Cell, Picture, Section, Table, cited
from .panels import PredictionPanel


def prediction_section(predictions: tuple[Prediction, ...]) -> Section:
    """Return each run predicted from all the others."""
    good = sum(p.at_noise for p in predictions)
    known = sum(bool(np.isfinite(p.predicted)) for p in predictions)
    lead = (
        "The vehicle is fitted on all other runs and must then predict the one that was left out; "
        "only the initial state and the sensors' offsets are the run's own. For a linear car what "
        "remains is noise; friction, a hot damper or a lifted wheel are not predicted. "
        f"Here {good} of {counted(known, 'run is', 'runs are')} predicted down to the noise."
    )
    if known < len(predictions):
        lead += f" For {len(predictions) - known} the others do not determine the vehicle."
    blocks: list[Block] = []
    if predictions:
        blocks = [_picture(predictions), _table(predictions)]
    return Section("prediction", "A run left out and predicted", lead, tuple(blocks))


def prediction_data(predictions: tuple[Prediction, ...]) -> dict[str, object]:
    """Return the predictions as data."""
    return {
        "left_out": {
            p.label: {
                "fitted": p.fitted,
                "predicted": p.predicted,
                "limit": p.limit,
                "at_noise": p.at_noise,
                "parameter": p.parameter,
                "moved": p.moved,
            }
            for p in predictions
        }
    }


def _picture(predictions: tuple[Prediction, ...]) -> Picture:
    return Picture(
        "prediction",
        "Fitted with all runs, and predicted from the others",
        "Grey: noise level, with five standard deviations of chance. A diamond far to the right of "
        "its circle is a run that the others do not predict.",
        PredictionPanel(
            tuple(p.label for p in predictions),
            np.array([p.fitted for p in predictions]),
            np.array([p.predicted for p in predictions]),
            np.array([p.limit for p in predictions]),
        ),
    )


def _table(predictions: tuple[Prediction, ...]) -> Table:
    data = prediction_data(predictions)
    rows = []
    for p in predictions:
        if np.isfinite(p.predicted):
            state = "✓ at noise level" if p.at_noise else "✕ not predicted"
            tail = (
                cited(data, "left_out", p.label, "predicted"),
                cited(data, "left_out", p.label, "limit"),
                Cell(state),
                cited(data, "left_out", p.label, "parameter", form=str),
                cited(data, "left_out", p.label, "moved", form="{:+.2f}".format),
            )
        else:
            note = Cell("the others do not determine all parameters")
            tail = (Cell(""), Cell(""), note, Cell(""), Cell(""))
        rows.append((Cell(p.label), cited(data, "left_out", p.label, "fitted"), *tail))
    return Table(
        "chi2/n of each run",
        ("run", "#fitted", "#predicted", "#limit", "", "moves most", "#by sigma"),
        tuple(rows),
        "Moves most: the parameter that changes most when the run is left out, in standard "
        "deviations of such a change; beyond 4 the run shows another car than the others.",
    )
