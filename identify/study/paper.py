"""Tables 2 and 3 and Figures 2 to 9 of the paper.

Table 3 compares the paper's chain and the maximum-likelihood estimate on the same simulated
campaigns, with a 16 Hz low-pass and the geometry measured.  The chain is given what no real car
provides: the number of modes, and each seed with and without the low-pass.  The likelihood takes
the records as they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daq.channels import paper_channels
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from dbc.words import InputError, counted

from ..model.matrices import N_DOF, delta_mass, physical_model
from ..model.response import exact_response, wilson_response
from ..modes.modal_model import ModalModel, displacement_shapes, modes_of, pair_modes
from ..modes.mode_selection import identify_modes
from ..modes.state_variable_method import Delays, delay_space, poles_of_rank
from ..paper import physical_matrices, sequential_vehicle, state_matrix_of
from .campaign import (
    BUMP,
    PAPER_ADDED_MASS,
    PAPER_CASES,
    RECORD_S,
    Campaign,
    outcome,
    records_of,
    require_noise,
)
from .result import Column, Curve, Panel, Study, percent

Floats = NDArray[np.float64]

KNOWN = FORD_GRANADA.to_array()
_VEHICLE = physical_model(FORD_GRANADA)
_DELTA_M = delta_mass(PAPER_ADDED_MASS, FORD_GRANADA.a).real
_TABLE2_PERCENT = np.array(
    [
        *(-0.011, -0.011, -0.023, 0.093, 0.095),
        *(-0.170, -0.078, -0.039, -0.032, -0.103, -0.087),
        *(-0.141, -0.130, -0.205, -0.161),
    ]
)
"""Error of each parameter without noise, as printed.  The values printed next to them have a
misprint (a = 1.282 m instead of 1.248 m) and are rounded for t_f and t_r."""
_TABLE3_PERCENT = np.array(
    [*(-2.307, 3.536, -2.918, 1.928, -2.379), *(1.594, -3.784, -2.248, 1.555, -3.647, 2.271)]
)
"""Error of each parameter with 30 dB of noise, a 16 Hz low-pass and the geometry measured."""


def table2_study(response: Literal["exact", "wilson"]) -> Study:
    """Return Table 2: the paper's vehicle by its chain, from its exact or Wilson-theta response."""
    response_of = exact_response if response == "exact" else wilson_response
    rate_hz = 1000.0  # the paper's
    state_matrices = []
    for model in (_VEHICLE, _VEHICLE.with_mass(_DELTA_M)):
        runs = [response_of(model, case, BUMP, rate_hz, RECORD_S) for case in PAPER_CASES]
        decays = [run.acceleration[run.time_s > BUMP.end_s - 0.5 / rate_hz] for run in runs]
        state_matrices.append(_state_matrix(identify_modes(decays, rate_hz)))
    A, A_added = state_matrices
    values = sequential_vehicle(physical_matrices(A, A_added, _DELTA_M)).to_array()
    errors = percent(values, KNOWN)
    notes = {
        "exact": (
            "The chain itself is exact; the paper's errors are those of its simulation: see"
            " --response wilson.",
        ),
        "wilson": (
            "The Wilson-theta method (theta 1.4, 1 ms) makes the errors that the paper prints: all"
            " five inertias to the last digit, the rest to 0.022 percentage points.",
            "The paper's table has a = 1.282 m next to -0.141 %: a misprint for 1.248 m.",
        ),
    }
    return Study(
        title=f"Table 2, {response} response, State Variable Method and Eqs. 22-33",
        columns=(
            Column("parameter", "parameter", PARAMETER_NAMES),
            Column("known", "known", KNOWN, "g"),
            Column("identified", "identified", values, ".9g"),
            Column("error_percent", "error %", errors, "+z.3g"),
            Column("paper_percent", "paper %", _TABLE2_PERCENT, "+z.3f"),
        ),
        notes=notes[response],
    )


def _state_matrix(sensed: ModalModel) -> Floats:
    """Return A from the modes that the paper's seven accelerations show."""
    return state_matrix_of(displacement_shapes(sensed, paper_channels(), FORD_GRANADA.geometry))


# Table 3 -----------------------------------------------------------------------------------------

PASS_HZ = 16.0
"""Section 4.3."""
_N = len(_TABLE3_PERCENT)  # parameters that are not measured


def taps(rate_hz: float) -> Floats:
    """Return the filter for samples at `rate_hz`, (n,), n odd and symmetric.

    Its length, which the paper does not state, is 50 ms: a filtered free decay is a free decay only
    where the whole memory lies in it, and the wheels lose three fifths of their motion in that
    time.  So short a filter is 35 dB down from 60 Hz, and little above 30 Hz.

    Raises InputError if the rate leaves no room for a stop band.
    """
    from scipy.signal import firls

    stop_hz = 60.0
    if rate_hz <= 2.0 * stop_hz:
        rate = f"{rate_hz:g} Hz leaves no room for a {PASS_HZ:g} Hz low-pass"
        raise InputError("rate", rate, f"give more than {2.0 * stop_hz:g} Hz")
    bands = (0.0, PASS_HZ, stop_hz, rate_hz / 2.0)
    n = 2 * round(0.05 * rate_hz / 2.0) + 1  # odd, 50 ms
    return np.asarray(firls(n, bands, (1.0, 1.0, 0.0, 0.0), fs=rate_hz), dtype=np.float64)


def filtered(values: Floats, rate_hz: float) -> Floats:
    """Return the filtered samples, (n - n_taps + 1, n_channels).

    There is a result only where the whole memory is filled; the first belongs to the middle of the
    first n_taps samples.
    """
    return np.apply_along_axis(np.convolve, 0, values, taps(rate_hz), "valid")


def table3_campaign(rate_hz: float, noise_db: float) -> Campaign:
    """Return the paper's campaign with the geometry measured.

    Raises InputError if the rate or the noise level cannot be studied, or leaves no room for the
    low-pass.
    """
    taps(rate_hz)
    return Campaign(rate_hz=rate_hz, noise_db=noise_db, geometry=FORD_GRANADA.geometry)


def attempt(campaign: Campaign, seed: int) -> dict[str, Floats]:
    """Return the errors of the paper's chain and of the likelihood on the campaign of a seed.

    They are the errors, (11,) %, of `chain_filtered` and `chain_unfiltered`, with and without the
    low-pass, and of the `likelihood`; NaN where there is no answer.
    """
    rate_hz = campaign.rate_hz
    by_state: dict[str, list[Floats]] = {}
    for record in records_of(campaign, seed):
        (recording,) = record.recordings
        decay = recording.values[recording.time_s > BUMP.end_s - 0.5 / rate_hz]
        # What follows after 1.5 s is mostly noise.
        by_state.setdefault(record.mass_state, []).append(decay[: round(1.5 * rate_hz)])
    low_passed = [[filtered(decay, rate_hz) for decay in decays] for decays in by_state.values()]
    likelihood = outcome(campaign, seed)
    return {
        "chain_filtered": _chain_errors(low_passed, rate_hz),
        "chain_unfiltered": _chain_errors(by_state.values(), rate_hz),
        "likelihood": np.full(_N, np.nan) if likelihood.lost else likelihood.errors_percent[:_N],
    }


def _chain_errors(states: Iterable[Sequence[Floats]], rate_hz: float) -> Floats:
    """Return the errors of the paper's chain, (11,) %; NaN if it gives no answer.

    `states`: the car as it is, then with the added mass; accelerations of each decay, (n, 7).  The
    modes are those of the State Variable Method of known order (Eqs. 14-21).
    """
    state_matrices = []
    try:
        for decays in states:
            rms = np.sqrt(np.mean(np.concatenate(list(decays)) ** 2, axis=0))
            # 30 delays of 10 ms each: of 8, 15 and 30 of them the most robust.
            delays = Delays(30, max(1, round(0.01 * rate_hz)))
            space = delay_space([decay / rms for decay in decays], rate_hz, delays)
            poles, shapes = poles_of_rank(space, 2 * N_DOF)
            vibrating = poles.imag > 0.0
            modes = ModalModel(poles[vibrating], (shapes * rms[:, None])[:, vibrating])
            state_matrices.append(_state_matrix(modes))
        A, A_added = state_matrices
        model = physical_matrices(A, A_added, _DELTA_M)
        vehicle = sequential_vehicle(model, FORD_GRANADA.geometry)
    except (InputError, np.linalg.LinAlgError):
        return np.full(_N, np.nan)
    return percent(vehicle.to_array(), KNOWN)[:_N]


def table3_study(campaign: Campaign, attempts: Sequence[Mapping[str, Floats]]) -> Study:
    """Return median and worst of many attempts (`attempt`) next to the paper's single one.

    `campaign`: of the attempts, as made by `table3_campaign`.
    """
    columns = [
        Column("parameter", "parameter", PARAMETER_NAMES[:_N]),
        Column("paper_percent", "paper", np.abs(_TABLE3_PERCENT), ".3f"),
    ]
    notes = []
    for route, label in (
        ("chain_filtered", f"chain, {PASS_HZ:g} Hz"),
        ("chain_unfiltered", "chain, unfiltered"),
        ("likelihood", "likelihood"),
    ):
        error_size = np.abs(np.array([errors[route] for errors in attempts]))
        answered = error_size[~np.isnan(error_size).any(axis=1)]
        median = worst = np.full(_N, np.nan)
        if len(answered):
            median, worst = np.median(answered, axis=0), answered.max(axis=0)
        columns.append(Column(f"{route}_median_percent", f"{label}: median", median, ".3g"))
        columns.append(Column(f"{route}_worst_percent", "worst", worst, ".3g"))
        missing = len(error_size) - len(answered)
        notes.append(f"{label}: no answer in {missing} of {counted(len(error_size), 'campaign')}.")
    return Study(
        title=f"Table 3, size of the errors in % at {campaign.noise_db:g} dB,"
        f" {campaign.rate_hz:g} Hz, geometry measured, {counted(len(attempts), 'campaign')}",
        columns=tuple(columns),
        notes=(
            *notes,
            "The paper's figures are of one realisation whose noise, sampling rate and choice of"
            " modes it does not state; they could not be reproduced.",
            "The chain is given the number of modes, the likelihood nothing but the geometry.",
        ),
    )


# Figures 2 to 9 -----------------------------------------------------------------------------------

_ERRORS_PERCENT = np.arange(-5.0, 6.0)
"""Errors on the abscissa of Figs. 3 to 8, %."""
_DYNAMIC = slice(5, 11)
"""Springs and dampers among the parameters."""

MASS_ERRORS: Mapping[str, tuple[str, tuple[int, ...], str]] = {
    "fig3": (
        "dm_s",
        (0,),
        "Paper: k_sf, k_sr, c_sf and c_sr fall from about 4 to -4 %, the geometry rises from about"
        " -5 to 5 %, the tyres hardly move.",
    ),
    "fig4": ("dI_yy", (1,), "Paper: only a and b move, from 2.4 to -2.6 %."),
    "fig5": ("dI_xx", (2,), "Paper: only t_f and t_r move, from 2.4 to -2.6 %."),
    "fig6": ("dm_uf", (3, 4), "Paper: all move by 5.6 % at most, the tyres' most."),
    "fig7": ("dm_ur", (5, 6), "Paper: all move by 5.6 % at most, the tyres' most."),
}
"""Name of each figure's wrong added inertia, its positions on the diagonal of the added mass, and
what the paper reads off its figure."""


def fig2_study() -> Study:
    """Return the shift of the modes when the mass grows by 2 to 14 % (Fig. 2).

    The added mass is that share of M itself, so that an undamped frequency would fall as
    ``1 / sqrt(1 + share)``; dampers make some modes fall more and some less.
    """
    shares = np.arange(2.0, 15.0, 2.0)
    baseline = modes_of(_VEHICLE.A)
    changes = []  # of frequency and damping ratio, (2, 7) for each share
    for share in shares / 100.0:
        loaded = modes_of(_VEHICLE.with_mass(share * _VEHICLE.M).A)
        partner = pair_modes(baseline, loaded).added  # wheel modes change places at 12 %
        frequency = percent(loaded.frequencies_hz[partner], baseline.frequencies_hz)
        damping = percent(loaded.damping_ratios[partner], baseline.damping_ratios)
        changes.append((frequency, damping))
    by_mode = np.transpose(changes)  # (7, 2, n_shares)
    panels = [
        Panel(
            f"{title} of modes 1 to 7",
            "added mass / % of M",
            "change / %",
            tuple(
                Curve(str(i + 1), shares, change, hue=1 if i < 3 else 2)  # of body, of wheels
                for i, change in enumerate(by_mode[:, k])
            ),
        )
        for k, title in enumerate(("Natural frequency", "Damping ratio"))
    ]
    return Study(
        title="Fig. 2, change of the modal frequencies in % by added mass in % of M",
        columns=(
            Column("mode", "mode", range(1, 8), "d"),
            Column("frequency_hz", "f / Hz", baseline.frequencies_hz, ".3f"),
            *(
                Column(f"at_{share:g}_percent", f"{share:g} %", change)
                for share, change in zip(shares, by_mode[:, 0].T, strict=True)
            ),
        ),
        notes=(
            "Paper: -0.98 % at 2 % of mass to -6.8 % at 14 %.",
            "Frequency is |lambda| / 2 pi. Modes are paired by shape: from 12 % on 4 and 5 swap.",
        ),
        panels=(tuple(panels),),
    )


def mass_error_study(figure: str) -> Study:
    """Return the effect of an error in one added inertia on the parameters (Figs. 3 to 7).

    The chain is the paper's (Eqs. 22-33, then its order of estimation) on the exact modes of both
    mass states: without noise that chain is exact, so all error comes from the added mass.

    `figure`: a key of `MASS_ERRORS`.
    """
    quantity, diagonal, paper_words = MASS_ERRORS[figure]
    A, A_added = _VEHICLE.A, _VEHICLE.with_mass(_DELTA_M).A
    identified = []
    for error in _ERRORS_PERCENT:
        stated = _DELTA_M.copy()
        stated[diagonal, diagonal] *= 1.0 - error / 100.0
        identified.append(sequential_vehicle(physical_matrices(A, A_added, stated)).to_array())
    errors = percent(np.array(identified), KNOWN)  # (11, 15)
    return Study(
        title=f"Fig. {figure.removeprefix('fig')}, identified parameters by an error in {quantity}",
        columns=(
            Column("parameter", "parameter", PARAMETER_NAMES),
            Column("at_minus_5_percent", "error at -5 %", errors[0]),
            Column("at_plus_5_percent", "error at +5 %", errors[-1]),
            Column("slope", "slope % / %", (errors[6] - errors[4]) / 2.0, "+z.3f"),
        ),
        notes=(
            paper_words,
            "Error e: the identification is given (1 - e) times what is on board. Row i of M, C and"
            " K is then (1 - e) times its true self, so K is no longer symmetric and least squares"
            " settles between its two halves.",
        ),
        panels=(
            (
                _error_panel("Dynamic parameters", quantity, errors, _DYNAMIC),
                _error_panel("Structural parameters", quantity, errors, slice(11, 15)),
            ),
        ),
    )


def _error_panel(title: str, quantity: str, errors: Floats, chosen: slice) -> Panel:
    """Return a diagram of the errors of some parameters over that of one quantity as it is stated.

    `errors`, (11, 15) %: of all parameters, a row for each error of that quantity.
    Front and rear parameters of a kind share a colour; the rear one is dashed.
    """
    curves = tuple(
        Curve(name, _ERRORS_PERCENT, row, hue=1 + i // 2, dashed=i % 2 == 1)
        for i, (name, row) in enumerate(zip(PARAMETER_NAMES[chosen], errors.T[chosen], strict=True))
    )
    return Panel(title, f"error of {quantity} / %", "error of the parameter / %", curves)


def fig8_study() -> Study:
    """Return the errors of the dynamic parameters by an error in a, b, t_f or t_r (Fig. 8).

    M, C and K are exact, as the chain gives them without noise, and do not depend on the geometry;
    only the parameters that are computed from C and K do.
    """
    geometry = FORD_GRANADA.geometry
    columns, panels = [Column("parameter", "parameter", PARAMETER_NAMES[_DYNAMIC])], []
    for length in ("a", "b", "t_f", "t_r"):
        identified = []
        for error in _ERRORS_PERCENT:
            stated = getattr(geometry, length) * (1.0 - float(error) / 100.0)
            vehicle = sequential_vehicle(_VEHICLE, replace(geometry, **{length: stated}))
            identified.append(vehicle.to_array())
        errors = percent(np.array(identified), KNOWN)
        at_minus_5, at_plus_5 = errors[0, _DYNAMIC], errors[-1, _DYNAMIC]
        columns.append(Column(f"{length}_at_minus_5_percent", f"{length} -5 %", at_minus_5))
        columns.append(Column(f"{length}_at_plus_5_percent", f"{length} +5 %", at_plus_5))
        panels.append(_error_panel(f"Error in {length}", length, errors, _DYNAMIC))
    return Study(
        title="Fig. 8, errors in % of the dynamic parameters by an error of -5 or 5 % in a length",
        columns=tuple(columns),
        notes=(
            "Paper: a moves k_sf and c_sf from about -4.8 to 4.7 %, b moves k_sr and c_sr from"
            " -5.8 to 5.9 %, t_f moves k_sf and c_sf from -0.74 to 4 %, a misprint for 0.4 %; t_r:"
            " -0.48 to 0.25 % and, c_sf, -0.35 to 0.15 %, with the error of its simulation.",
            "Error e: the identification is given (1 - e) times the true length. C and K are fitted"
            " in all elements, each with the same weight. m_s, I_yy, I_xx, m_uf, m_ur do not move.",
        ),
        panels=(tuple(panels[:2]), tuple(panels[2:])),
    )


def fig9_study(rate_hz: float, noise_db: float, seed: int) -> Study:
    """Return the effect of the paper's low-pass on the accelerations of a bounce run (Fig. 9).

    `rate_hz`: samples a second.  `noise_db`: distance from signal to noise.  `seed`: draws the
    noise.  Raises InputError if a rate or noise level cannot be studied.
    """
    campaign = Campaign(rate_hz=rate_hz, noise_db=noise_db, cases=(Excitation.BOUNCE,))
    require_noise(campaign)
    noisy = records_of(campaign, seed)[0].recordings[0]
    clean = records_of(replace(campaign, noise_db=inf), seed)[0].recordings[0]
    noisy_low, clean_low = (filtered(values, rate_hz) for values in (noisy.values, clean.values))
    half = len(taps(rate_hz)) // 2  # samples on either side that the filter needs
    time, time_low = noisy.time_s, noisy.time_s[half : len(noisy.time_s) - half]
    free, free_low = time > BUMP.end_s, time_low > BUMP.end_s + half / rate_hz
    names = [channel.name for channel in noisy.group.channels]
    titles = {"z_s": "Body, vertical (z_s)", "z_uA": "Front left hub (z_uA)"}
    indices = [names.index(name) for name in titles]
    signal, signal_low = clean.values[:, indices], clean_low[:, indices]  # (n_samples, 2)
    noise, noise_low = noisy.values[:, indices] - signal, noisy_low[:, indices] - signal_low
    decibels = 20.0 * np.log10(_rms(signal[free]) / _rms(noise[free]))
    decibels_low = 20.0 * np.log10(_rms(signal_low[free_low]) / _rms(noise_low[free_low]))
    y_label, panels = "acceleration / (m/s²)", []
    for c, title in zip(indices, titles.values(), strict=True):
        curves = ("noisy", time, noisy.values[:, c], 0), ("filtered", time_low, noisy_low[:, c], 2)
        whole, enlarged = (
            tuple(
                Curve(label, t[(t >= from_s) & (t <= to_s)], v[(t >= from_s) & (t <= to_s)], hue)
                for label, t, v, hue in curves
            )
            for from_s, to_s in ((0.0, 1.2), (0.5, 0.8))
        )
        panels.append(
            (
                Panel(title, "time / s", y_label, whole),
                Panel("The same, enlarged", "time / s", f"{y_label}, enlarged", enlarged),
            )
        )
    return Study(
        title=f"Fig. 9, bounce run with {noise_db:g} dB of noise at {rate_hz:g} Hz, {PASS_HZ:g} Hz"
        " linear-phase FIR low-pass",
        columns=(
            Column("channel", "channel", tuple(titles)),
            Column("signal_rms", "signal m/s²", _rms(signal), ".3f"),
            Column("noise_rms", "noise m/s²", _rms(noise), ".4f"),
            Column("noise_filtered_rms", "noise filtered m/s²", _rms(noise_low), ".4f"),
            Column("decay_db", "decay dB", decibels, ".1f"),
            Column("decay_filtered_db", "decay filtered dB", decibels_low, ".1f"),
        ),
        notes=(
            f"The filter ({2 * half + 1} taps, least squares, stop band from 60 Hz) does not delay:"
            " its results belong to the middle of its memory.",
            "Noise counts from the rms over whole bounce, pitch and roll runs, bumps included. The"
            " free decay, which alone is identified, is weaker: the last columns.",
        ),
        panels=tuple(panels),
    )


def _rms(values: Floats) -> Floats:
    """Return the root of the mean square of each column."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
