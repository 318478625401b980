"""The whole method: a session in, physical parameters with intervals and a verdict out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from math import log, nan
from time import process_time
from typing import TYPE_CHECKING

from daq.sessions import Session
from daq.vehicle import VehicleGeometry, expected_car
from dbc.words import Finding, InputError, Severity

from .decays.decay import Record
from .decays.usable import usable
from .fit.estimation import Estimation, first_estimate, generic_vehicles, later_estimate
from .fit.grey_box import GreyBox
from .fit.uncertainty import (
    correlation,
    derived_estimates,
    drivers,
    estimates,
    mode_estimates,
    motion_ratio_estimates,
)
from .model.matrices import Full, loaded_model
from .modes.modal_model import mode_names, modes_of, pair_modes
from .modes.mode_selection import sensed_modes
from .paper import closed_form
from .result import Identification
from .trust.causes import faults_of_bench, first_cause, judge, swapped_or_late
from .trust.finding import Judgement
from .trust.gates import CHI2_LIMIT, missing_runs, undetermined, with_widest_intervals
from .trust.hypotheses import rank_causes, some_runs_are_wrong
from .trust.inputs import shortcomings, unused_findings
from .trust.trials import mistyped_weight

if TYPE_CHECKING:
    from .nonlinear.real_car import RealCar

Progress = Callable[[float, str], None]
"""Receives the share of the work that is done, 0..1, and the next step."""

_LONGEST_S = 60.0
"""CPU time of an identification, s, at most: `identify.nonlinear` ends its search in time."""
_JUDGING_S, _LEAST_S = 2.0, 20.0
"""CPU time, s, kept for judging a fit, and that which a search for elements has in any case."""


def identify(
    session: Session,
    progress: Progress = lambda *_: None,
    stop: Callable[[], object] = lambda: False,
) -> Identification:
    """Identify the physical parameters of a session's vehicle, and its modes by the paper's method.

    The parameters are those of `identify_parameters`.  The State Variable Method and the paper's
    equations are reported in addition: with noise they seldom give a vehicle that would be a
    better start.

    `session`: accepted runs in two mass states, or in one with scales among the facts.  `progress`:
    called as the work goes on.  `stop`: asked after each stage of the fit with elements; where it
    returns True, the answer is the linear fit so far, with a warning.  Where the data do not
    support a result, its verdict is `refused`, with reasons.
    """
    result = identify_parameters(session, progress, stop)
    if result.estimation is None:
        return result
    progress(0.8, "modes")
    estimation, sensed = result.estimation, {}
    # The modes of a car with friction change as it comes to rest: it has no fixed modes.
    for state in result.modal if estimation.nonlinear is None else ():
        runs = [i for i, record in enumerate(estimation.records) if record.mass_state == state]
        records = [estimation.records[i] for i in runs]
        decays = [estimation.decays[i].thinned(250.0) for i in runs]  # Hz, enough for the modes
        with suppress(InputError):  # too short, or no common channel: no modes of this state
            sensed[state] = sensed_modes(records, decays)
    states = [state for state in session.mass_states if state.name in result.modal]
    result = replace(result, sensed={name: modes.model for name, modes in sensed.items()})
    try:
        chain = closed_form(sensed, states, result.geometry, session.vehicle.geometry)
    except InputError as error:
        return replace(result, closed_form_reason=str(error))
    chain_parameters = asdict(chain.parameters)
    return replace(result, closed_form=chain_parameters, closed_form_damping=chain.damping)


def identify_parameters(
    session: Session,
    progress: Progress = lambda *_: None,
    stop: Callable[[], object] = lambda: False,
) -> Identification:
    """Identify by maximum likelihood alone, without the State Variable Method: half the time.

    Maximum likelihood on the free decays gives the parameters; the search starts from generic
    vehicles.  Arguments and result are those of `identify`; `sensed` and the closed form stay
    empty.
    """
    used = usable(session)
    unused = tuple(unused_findings(session, used))
    session, records = used.session, used.records
    missing = shortcomings(records, session, unused)
    if missing:
        return Identification(Judgement(missing, nan), session.provenance)
    progress(0.1, "fitting")
    began_s, vehicles = process_time(), generic_vehicles()
    linear = estimation = first_estimate(grey_box(session, records), records, vehicles)
    # What the fit leaves is explained by the bench, by longer bumps, by swapped or late sensors,
    # by a mistyped weight, or by the elements of a car that is not linear, in this order.
    causes, forces = faults_of_bench(session, linear), None
    if not (linear.holds or causes.findings):
        progress(0.5, "fitting again")
        estimation = later_estimate(linear, vehicles)
        if not estimation.holds:
            causes = swapped_or_late(linear)
    if not (estimation.holds or causes.findings) and (share := share_of_faults(linear)) < 1.0:
        causes = first_cause(linear, (mistyped_weight,), 0.0)  # of any size: friction adds to it
        if not causes.findings:
            real = None
            try:
                real = _with_elements(session, linear, share, began_s, progress, stop)
            except _StoppedError:
                text = (
                    "stopped by a person before friction, bars and stops of the car were fitted: "
                    "identify again for the whole answer"
                )
                unused = (*unused, Finding("stopped", Severity.WARNING, text))
            if real:
                estimation, forces = real.estimation, real.forces
    estimation = with_widest_intervals(estimation)
    box, fit = estimation.box, estimation.fit
    full = estimation.full
    present = {record.mass_state for record in records}
    states = [state for state in session.mass_states if state.name in present]
    physical = {state.name: loaded_model(full, state.added) for state in states}
    modal = {name: modes_of(model.A) for name, model in physical.items()}
    first, *others = modal
    geometry = VehicleGeometry(*(float(length) for length in full[Full.A : Full.T_R + 1]))
    progress(0.7, "judging")
    return Identification(
        quality=judge(session, estimation, unused, causes),
        provenance=session.provenance,
        vehicle=session.vehicle.name,
        parameters=estimates(box, fit),
        derived=derived_estimates(box, fit),
        motion_ratios=motion_ratio_estimates(box, fit),
        correlation=correlation(box, fit),
        drivers=drivers(box, fit),
        modal=modal,
        modes={name: mode_estimates(box, fit, name) for name in modal},
        mode_names={name: mode_names(model, geometry) for name, model in modal.items()},
        pairings={name: pair_modes(modal[first], modal[name]) for name in others},
        physical=physical,
        noise=estimation.sigma,
        estimation=estimation,
        forces=forces,
    )


class _StoppedError(Exception):
    """A person stops the search for elements: the linear fit is the answer."""


def grey_box(session: Session, records: Sequence[Record]) -> GreyBox:
    """Return the structure of a session's problem; every channel group that occurs, once.

    Weights without a sigma have that of scales and tape (`MassState.weighed`).
    """
    groups = dict.fromkeys(r.group for record in records for r in record.recordings)
    vehicle = session.vehicle
    states = tuple(state.weighed() for state in session.mass_states)
    return GreyBox(tuple(groups), states, vehicle.geometry, vehicle.structure, vehicle.facts)


# Elements of the car or faults of the bench: which explain what the linear fit leaves -------------


def share_of_faults(linear: Estimation) -> float:
    """Return the part of the misfit that a fault of the bench explains; 1 if no elements can.

    A car differs from the linear model in all runs: where some runs are wrong, no elements are
    sought, nor in decays of less than half a second, nor where the parameters are undetermined for
    want of a kind of run.

    `linear`: a linear fit that does not hold, nor does one from a later start.
    """
    longest_s = max(float(r.time_s[-1]) for d in linear.decays for r in d.recordings)
    lacks_runs = missing_runs(linear) and undetermined(linear)
    # In less than half a period of the body, a decay does not show how its size affects the motion.
    if longest_s < 0.5 or lacks_runs or some_runs_are_wrong(linear):
        return 1.0
    excess = max(linear.chi2_per_n - 1.0, 0.0)
    share = min(max(s.explained for s in rank_causes(linear) if s.of_bench), 1.0)
    return 1.0 if 1.0 + excess * (1.0 - share) <= linear.chi2_limit else share


def _with_elements(
    session: Session,
    linear: Estimation,
    share: float,
    began_s: float,
    progress: Progress,
    stop: Callable[[], object],
) -> RealCar | None:
    """Return the fit with nonlinear elements where it explains the decays best; None where not.

    A fault of the bench (a late or wrongly scaled sensor, swapped labels) that explains the misfit
    with one number or none takes precedence over a dozen elements that explain it equally well:
    each number has a price (Bayesian information criterion).

    `session`: with the elements that `[vehicle.structure]` forces or forbids.  `linear`: a linear
    fit that does not hold, nor does one from a later start.  `share`: of its misfit that faults of
    the bench explain (`share_of_faults`).  `began_s`: processor time at which the identification
    began, s.  Raises _StoppedError where `stop` asks for it.
    """
    from .nonlinear.real_car import real_car  # with Numba: a third of a second to import

    end_s = max(began_s + _LONGEST_S, process_time() + _LEAST_S + _JUDGING_S)

    def log_stage(stage: str) -> None:
        rest_s = max(end_s - process_time(), 0.0)
        progress(0.7 - 0.2 * rest_s / _LONGEST_S, f"{stage}; at most {rest_s:.0f} s left")
        if stop():
            raise _StoppedError

    mass_kg, front, rear = linear.full[[Full.M_S, Full.K_S, Full.K_S + 2]]
    log_stage(
        f"so far: body {mass_kg:,.0f} kg, springs {front * 1e-3:.1f} and {rear * 1e-3:.1f} kN/m, "
        f"chi2/n {linear.chi2_per_n:.2f}"
    )
    vehicles = generic_vehicles(expected_car(session.vehicle).to_array())  # of the stated size
    most_s = end_s - _JUDGING_S - process_time()
    real = real_car(linear, vehicles, session.vehicle.elements, log_stage, most_s)
    if real is None or not real.estimation.chi2_per_n <= CHI2_LIMIT:
        return None
    n = linear.freedom
    unexplained = max(linear.chi2_per_n - 1.0, 0.0) * (1.0 - share)
    price = sum(choice.threshold for choice in real.forces.choices if choice.kept)
    by_elements = max(real.estimation.chi2_per_n - 1.0, 0.0) * n + price
    return real if by_elements < unexplained * n + log(n) else None
