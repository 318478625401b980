"""Records, reads and simulates measurements: from the wire to a session file.

Public names are loaded at their first use, so that the terminal shows its first screen within a
second.
"""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .arrays import session_from_arrays as session_from_arrays
    from .bench.config import Bench as Bench
    from .bench.config import bench_codec as bench_codec
    from .bench.config import load_bench as load_bench
    from .bus.interfaces import open_source as open_source
    from .channels import Channel as Channel
    from .channels import Quantity as Quantity
    from .channels import paper_channels as paper_channels
    from .control.messages import Status as Status
    from .derive.from_logs import session_from_log as session_from_log
    from .errors import BumpbenchError as BumpbenchError
    from .errors import BusError as BusError
    from .errors import InputError as InputError
    from .files import file_sha256 as file_sha256
    from .formats.log import read_log as read_log
    from .recorder.recorder import Recorder as Recorder
    from .runs import ADDED as ADDED
    from .runs import BASELINE as BASELINE
    from .runs import Event as Event
    from .runs import Excitation as Excitation
    from .runs import Losses as Losses
    from .runs import Run as Run
    from .runs import RunStatus as RunStatus
    from .runs import SampleGroup as SampleGroup
    from .samples.mapping import map_channels as map_channels
    from .samples.trigger import mapped_channels as mapped_channels
    from .session import read_session as read_session
    from .session import validate_session as validate_session
    from .session import write_session as write_session
    from .sessions import Session as Session
    from .sessions import session_part as session_part
    from .vehicle import FORD_GRANADA as FORD_GRANADA
    from .vehicle import AddedMass as AddedMass
    from .vehicle import BodyWeight as BodyWeight
    from .vehicle import Corner as Corner
    from .vehicle import HubWeight as HubWeight
    from .vehicle import MassState as MassState
    from .vehicle import Vehicle as Vehicle
    from .vehicle import VehicleGeometry as VehicleGeometry
    from .vehicle import VehicleParameters as VehicleParameters
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
