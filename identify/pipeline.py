"""The whole method: a session in, physical parameters with intervals and a verdict out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import nan

import numpy as np

from daq.runs import RunStatus, Session
from daq.vehicle import MassState, VehicleGeometry, VehicleParameters
from dbc.errors import InputError

from .decay import Record, record_of
from .estimation import Estimation, estimate, generic_vehicles
from .greybox import GreyBox
from .modal import ModalModel, modes_of
from .model import PhysicalModel, delta_mass, physical_model
from .pairing import Pairing, pair_modes
from .quality import Quality, Verdict, judge, shortcomings
from .sensed import SensedModes, closed_form, sensed_modes
from .uncertainty import Estimate, estimates


@dataclass(frozen=True, slots=True)
class Identification:
    """What a session says of its vehicle.

    Parameters
    ----------
    parameters : mapping of str to Estimate
        The 15 parameters with 95 % intervals (maximum likelihood); empty if no fit was possible.
    modal : mapping of mass state to ModalModel
        Modes of the identified vehicle, shapes in `daq.vehicle.DOF`.
    pairings : mapping of mass state to Pairing
        How the modes of each further mass state follow from those of the first, by MAC: with mass
        on board, wheel modes that are nearly equal may change their order.
    sensed : mapping of mass state to ModalModel
        Modes by the State Variable Method alone, shapes in the channels' units.
    closed_form : mapping of str to float
        Parameters by the paper's chain (Eqs. 22-33); empty where it has no answer.
    physical : mapping of mass state to PhysicalModel
        M, C and K of the identified vehicle.
    quality : Quality
        Verdict, reasons and goodness of fit.
    provenance : mapping of str to str
        Of the session.
    """

    parameters: Mapping[str, Estimate]
    modal: Mapping[str, ModalModel]
    pairings: Mapping[str, Pairing]
    sensed: Mapping[str, ModalModel]
    closed_form: Mapping[str, float]
    physical: Mapping[str, PhysicalModel]
    quality: Quality
    provenance: Mapping[str, str]


def identify(session: Session) -> Identification:
    """Identify the physical parameters of a session's vehicle.

    Maximum likelihood on the free decays gives the parameters, from generic vehicles to start
    with.  The State Variable Method and the paper's equations are reported beside it: with noise
    they seldom give a vehicle that would be a better start.

    Parameters
    ----------
    session : Session
        Accepted runs in at least two mass states.

    Returns
    -------
    Identification
        With verdict `refused` and reasons where the data do not carry a result.
    """
    records = usable_records(session)
    missing = shortcomings(records, session.mass_states)
    if missing:
        quality = Quality(Verdict.REFUSED, missing, nan, {})
        return Identification({}, {}, {}, {}, {}, {}, quality, session.provenance)
    box = grey_box(session, records)
    estimation = estimate(box, records, generic_vehicles())
    parameters = estimates(box, estimation.fit)
    vehicle = VehicleParameters(**{name: e.value for name, e in parameters.items()})
    present = {record.mass_state for record in records}
    states = [state for state in session.mass_states if state.name in present]
    physical = {state.name: _loaded(vehicle, state) for state in states}
    modal = {name: modes_of(model.A) for name, model in physical.items()}
    first, *others = modal
    sensed = _sensed(records, estimation, states)
    return Identification(
        parameters=parameters,
        modal=modal,
        pairings={name: pair_modes(modal[first], modal[name]) for name in others},
        sensed={name: modes.model for name, modes in sensed.items()},
        closed_form=_closed_form(sensed, states, vehicle, session.vehicle.geometry),
        physical=physical,
        quality=judge(estimation, parameters),
        provenance=session.provenance,
    )


def usable_records(session: Session) -> tuple[Record, ...]:
    """Return what the accepted runs of a session hold for the identification."""
    accepted = (run for run in session.runs if run.status is RunStatus.ACCEPTED)
    records = (record_of(run, session.channels) for run in accepted)
    return tuple(record for record in records if record.recordings)


def grey_box(session: Session, records: Sequence[Record]) -> GreyBox:
    """Return the structure of a session's problem; every sample clock that occurs, once."""
    clocks = dict.fromkeys(r.clock for record in records for r in record.recordings)
    return GreyBox(tuple(clocks), session.mass_states, session.vehicle.geometry)


def _loaded(vehicle: VehicleParameters, state: MassState) -> PhysicalModel:
    return physical_model(vehicle).with_mass(delta_mass(state.added, vehicle.a).real)


def _sensed(
    records: Sequence[Record], estimation: Estimation, states: Sequence[MassState]
) -> dict[str, SensedModes]:
    """Return the modes by the State Variable Method, of the states where it has an answer."""
    result = {}
    for state in states:
        mine = [i for i, record in enumerate(records) if record.mass_state == state.name]
        with suppress(InputError):  # too short, no common channel: the likelihood needs neither
            result[state.name] = sensed_modes(
                [records[i] for i in mine], [estimation.decays[i] for i in mine]
            )
    return result


def _closed_form(
    sensed: Mapping[str, SensedModes],
    states: Sequence[MassState],
    vehicle: VehicleParameters,
    known: VehicleGeometry | None,
) -> dict[str, float]:
    """Return the parameters by the paper's chain, empty where it has no answer."""
    if len(states) != 2 or len(sensed) != 2:
        return {}
    first, second = states
    with suppress(InputError, np.linalg.LinAlgError):
        chain = closed_form(
            sensed[first.name], sensed[second.name], (first, second), vehicle.geometry, known
        )
        return asdict(chain.parameters)
    return {}
