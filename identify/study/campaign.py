"""Simulated campaigns of the paper's vehicle, and a Monte Carlo against the Cramer-Rao bound.

Noise of a level in dB is white and Gaussian, independent on each channel, and this level below the
channel's rms over the three complete records (bounce, pitch, roll) of its mass state
(docs/method.md, "Noise and the bound").  A channel that is silent by symmetry in one run has noise
there, too, and one more run does not change the noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel, Quantity, paper_channels
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES, AddedMass, Corner, MassState, VehicleGeometry
from dbc.words import InputError, counted

from ..decays.decay import ChannelGroup, Record, Recording
from ..fit.estimation import estimate, generic_vehicles
from ..fit.grey_box import GreyBox
from ..fit.likelihood import fit
from ..fit.uncertainty import COVERAGE_95, Estimate, estimates
from ..model.matrices import delta_mass, physical_model
from ..model.response import Bump, exact_response
from ..modes.modal_model import sensor_rows
from .result import Column, Study, percent

Floats = NDArray[np.float64]

PAPER_ADDED_MASS = AddedMass(matrix=np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))
"""Eq. 36."""
PAPER_MASS_STATES = (MassState(BASELINE), MassState(ADDED, PAPER_ADDED_MASS))
PAPER_CASES = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
"""Section 3.1."""

_IMU = ChannelGroup(
    "imu",
    (
        Channel("imu_z", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.05, y_m=0.0),
        Channel("pitch_rate", Quantity.PITCH_RATE, "rad/s"),
        Channel("roll_rate", Quantity.ROLL_RATE, "rad/s"),
    ),
)
"""IMU on the tunnel, 0.2 m in front of the CG, as on the shipped bench."""
_HUBS = ChannelGroup(
    "hubs", tuple(Channel(f"hub_{c}", Quantity.HUB_ACCELERATION, "m/s2", corner=c) for c in Corner)
)
_TRAVELS = ChannelGroup(
    "travels",
    tuple(Channel(f"travel_{c}", Quantity.SUSPENSION_TRAVEL, "m", corner=c) for c in Corner),
)
SENSOR_SETS: Mapping[str, tuple[ChannelGroup, ...]] = {
    "paper": (ChannelGroup("acceleration", paper_channels()),),
    "imu+hubs": (_IMU, _HUBS),
    "imu+travels": (_IMU, _TRAVELS),
    "all": (_IMU, _HUBS, _TRAVELS),
}
"""Channels that are sampled together: the paper's accelerations of the seven degrees of freedom, or
an IMU with the accelerations of the four hubs, with the four suspension travels, or with both."""

BUMP = Bump()
RECORD_S = 3.0
_MOST_CHI2, _MOST_STD_PERCENT = 1.5, 25.0  # chi2/n and standard deviations of usable fits


@dataclass(frozen=True, slots=True)
class Campaign:
    """Runs of the paper's vehicle: each case in each mass state, 3 s, the bump at 0.1..0.3 s.

    Raises InputError if a rate, a noise level or the cases cannot be studied.
    """

    rate_hz: float = 200.0
    """Samples a second of every sensor, 40 (four times the wheel modes) to 20,000."""
    noise_db: float = 30.0
    """Distance from signal to noise; infinite for none."""
    cases: tuple[Excitation, ...] = PAPER_CASES
    """Kinds of bumps, each once in a mass state."""
    groups: tuple[ChannelGroup, ...] = SENSOR_SETS["paper"]
    """Sensors, for example one of `SENSOR_SETS`."""
    mass_states: tuple[MassState, ...] = PAPER_MASS_STATES
    """Loading of the vehicle."""
    geometry: VehicleGeometry | None = None
    """The four lengths as given to the identification; None leaves them to be identified."""

    def __post_init__(self) -> None:
        if not 40.0 <= self.rate_hz <= 20_000.0:
            rate = f"{self.rate_hz:g} Hz cannot be studied"
            raise InputError("rate", rate, "give 40 to 20000 Hz")
        if not self.noise_db >= -20.0:
            noise = f"{self.noise_db:g} dB cannot be studied"
            raise InputError("noise", noise, "give -20 dB or more")
        if not self.cases or len(set(self.cases)) < len(self.cases):
            raise InputError("cases", "none, or one named twice", "name each case once")


def require_noise(campaign: Campaign) -> None:
    """Raise InputError for a campaign without noise, or with noise near rounding: above 100 dB."""
    if campaign.noise_db > 100.0:
        noise = f"{campaign.noise_db:g} dB leaves no noise to study"
        raise InputError("noise", noise, "give -20 to 100 dB")


def records_of(campaign: Campaign, seed: int) -> tuple[Record, ...]:
    """Return the records of a campaign with the noise that `seed` draws."""
    rng = np.random.default_rng(seed)
    records = []
    for state in campaign.mass_states:
        levels = _noise_stds(campaign, state)
        for case in campaign.cases:
            noisy = tuple(
                Recording(r.group, r.time_s, r.values + level * rng.standard_normal(r.values.shape))
                for r, level in zip(_clean_recordings(campaign, state, case), levels, strict=True)
            )
            label = f"{state.name}_{case}_1"
            records.append(Record(label, state.name, BUMP.duration_s, noisy))
    return tuple(records)


def noise_levels(campaign: Campaign) -> dict[str, float]:
    """Return each channel's noise, SI, pooled over its mass states, which differ little."""
    levels = [np.concatenate(_noise_stds(campaign, state)) for state in campaign.mass_states]
    names = [channel.name for group in campaign.groups for channel in group.channels]
    return dict(zip(names, np.sqrt(np.mean(np.square(levels), axis=0)).tolist(), strict=True))


def box_of(campaign: Campaign) -> GreyBox:
    """Return the problem that a campaign poses; weights without a sigma get a usual one."""
    states = tuple(state.weighed() for state in campaign.mass_states)
    return GreyBox(campaign.groups, states, campaign.geometry)


def _clean_recordings(campaign: Campaign, state: MassState, case: Excitation) -> list[Recording]:
    """Return what the sensors see in one case of one mass state, without noise."""
    loaded = physical_model(FORD_GRANADA).with_mass(delta_mass(state.added, FORD_GRANADA.a).real)
    response = exact_response(loaded, case, BUMP, campaign.rate_hz, RECORD_S)
    motion = response.displacement, response.velocity, response.acceleration
    recordings = []
    for group in campaign.groups:
        rows = sensor_rows(group.channels, FORD_GRANADA.geometry)
        derivatives = [TIME_DERIVATIVE[channel.quantity] for channel in group.channels]
        columns = [motion[d] @ row for d, row in zip(derivatives, rows, strict=True)]
        recordings.append(Recording(group, response.time_s, np.column_stack(columns)))
    return recordings


def _noise_stds(campaign: Campaign, state: MassState) -> list[Floats]:
    """Return each group's noise, as stds of channels, from the paper's cases in a mass state."""
    noise_share = 10 ** (-campaign.noise_db / 20)
    by_case = [_clean_recordings(campaign, state, case) for case in PAPER_CASES]
    return [
        noise_share * np.sqrt(np.mean([np.mean(r.values**2, axis=0) for r in recordings], axis=0))
        for recordings in zip(*by_case, strict=True)
    ]


# Monte Carlo against the bound --------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Outcome:
    """One campaign identified."""

    errors_percent: Floats
    stds_percent: Floats
    """`errors_percent`, `stds_percent`: error and stated standard deviation in per cent of the true
    value, shape (15,); both are zero for a length that was given."""
    lost: bool
    """True if the fit did not settle, leaves more than noise, or leaves a parameter open."""


def outcome(campaign: Campaign, seed: int) -> Outcome:
    """Return how well the campaign that `seed` draws is identified."""
    box = box_of(campaign)
    estimation = estimate(box, records_of(campaign, seed), generic_vehicles())
    identified = estimates(box, estimation.fit)
    values = [identified[name].value for name in PARAMETER_NAMES]
    stds = _stds_percent(identified)
    holds = estimation.fit.converged and estimation.chi2_per_n <= _MOST_CHI2
    usable = holds and np.all(stds <= _MOST_STD_PERCENT)
    return Outcome(percent(values, FORD_GRANADA.to_array()), stds, lost=not usable)


def bound_percent(campaign: Campaign) -> Floats:
    """Return the Cramer-Rao bound of each parameter's standard deviation, (15,), in % of its value.

    No unbiased estimate has a smaller one.  Infinite where the campaign does not determine a
    parameter, zero for a length that is given.

    Raises InputError if the campaign has no noise, or noise below rounding.
    """
    require_noise(campaign)
    box = box_of(campaign)
    clean_records = records_of(replace(campaign, noise_db=inf), 0)
    # From just before the sample at the end of the bump, which is one of the decay.
    decays = tuple(record.decay(BUMP.end_s - 1e-9) for record in clean_records)
    truth = box.unknowns(FORD_GRANADA.to_array())
    bound = _stds_percent(estimates(box, fit(box, decays, noise_levels(campaign), truth)))
    # Above 1e6 % a parameter is not determined: the bound is infinite except for rounding.
    return np.where(bound < 1e6, bound, inf)


def _stds_percent(parameters: dict[str, Estimate]) -> Floats:
    """Return each parameter's standard deviation, (15,), in % of its true value."""
    stds = np.array([parameters[name].std for name in PARAMETER_NAMES])
    return np.asarray(100.0 * stds / FORD_GRANADA.to_array())


def noise_study(campaign: Campaign, bound: Floats, outcomes: Sequence[Outcome]) -> Study:
    """Return the statistics of many campaigns; `bound`, (15,): as `bound_percent` has it."""
    n = len(PARAMETER_NAMES) - (4 if campaign.geometry else 0)  # the lengths, if given, are last
    names, bound = PARAMETER_NAMES[:n], bound[:n]
    identified = [outcome for outcome in outcomes if not outcome.lost]
    rms = stated_rms = coverage = np.full(n, np.nan)
    if identified:
        errors = np.array([outcome.errors_percent[:n] for outcome in identified])
        stds = np.array([outcome.stds_percent[:n] for outcome in identified])
        rms, stated_rms = (np.sqrt(np.mean(each**2, axis=0)) for each in (errors, stds))
        coverage = 100.0 * np.mean(np.abs(errors) <= COVERAGE_95 * stds, axis=0)
    ratio = rms / bound
    notes = [
        f"lost: {len(outcomes) - len(identified)} of {len(outcomes)} (not converged, chi2/n above"
        f" {_MOST_CHI2:g}, or a standard deviation above {_MOST_STD_PERCENT:g} %)"
    ]
    if undetermined := [name for name, std in zip(names, bound, strict=True) if std == inf]:
        remedy = "take bounce, pitch and roll"
        notes.append(f"these cases do not determine {', '.join(undetermined)}: {remedy}")
    if identified:
        notes += [
            f"rms error {rms.max():.3f} % at most; {ratio.min():.3f} .. {ratio.max():.3f} times"
            f" the bound, {sqrt(np.mean(ratio**2)):.3f} in the mean square",
            f"95 % intervals hold the truth {coverage.mean():.1f} % of the time",
        ]
    return Study(
        title=f"Noise study: {counted(len(outcomes), 'campaign')} at {campaign.noise_db:g} dB,"
        f" {campaign.rate_hz:g} Hz, {', '.join(campaign.cases)}",
        columns=(
            Column("parameter", "parameter", names),
            Column("rms_error_percent", "rms error %", rms, ".3f"),
            Column("stated_std_percent", "stated std %", stated_rms, ".3f"),
            Column("bound_percent", "Cramer-Rao %", bound, ".3f"),
            Column("ratio", "error / bound", ratio, ".3f"),
            Column("coverage_percent", "coverage %", coverage, ".1f"),
        ),
        notes=tuple(notes),
    )
