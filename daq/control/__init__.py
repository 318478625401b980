"""Connects the recorder to other processes: orders, status, sockets, the service manager."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .address import control_address as control_address
    from .address import is_running as is_running
    from .client import Client as Client
    from .client import OrderRefusedError as OrderRefusedError
    from .client import RecorderGoneError as RecorderGoneError
    from .lock import group_readable as group_readable
    from .lock import is_locked as is_locked
    from .lock import lone_recorder as lone_recorder
    from .lock import unreachable_words as unreachable_words
    from .messages import STATUS as STATUS
    from .messages import Alarm as Alarm
    from .messages import BusState as BusState
    from .messages import CheckItem as CheckItem
    from .messages import Live as Live
    from .messages import Phase as Phase
    from .messages import Reply as Reply
    from .messages import SessionState as SessionState
    from .messages import Setup as Setup
    from .messages import Tally as Tally
    from .messages import differences as differences
    from .messages import setup_of as setup_of
    from .monitoring import Systemd as Systemd
    from .monitoring import status_line as status_line
    from .monitoring import write_figures as write_figures
    from .orders import QUESTIONS as QUESTIONS
    from .orders import Accept as Accept
    from .orders import Acknowledge as Acknowledge
    from .orders import Arm as Arm
    from .orders import AskBench as AskBench
    from .orders import AskCheck as AskCheck
    from .orders import AskHistory as AskHistory
    from .orders import AskSetup as AskSetup
    from .orders import AskStatus as AskStatus
    from .orders import Build as Build
    from .orders import Choose as Choose
    from .orders import Configure as Configure
    from .orders import Hello as Hello
    from .orders import LeaveOut as LeaveOut
    from .orders import Mark as Mark
    from .orders import Note as Note
    from .orders import Order as Order
    from .orders import OverrideWarning as OverrideWarning
    from .orders import Pause as Pause
    from .orders import Redo as Redo
    from .orders import Reject as Reject
    from .orders import ShutDown as ShutDown
    from .orders import Start as Start
    from .orders import Stop as Stop
    from .orders import Undo as Undo
    from .orders import Until as Until
    from .server import Server as Server
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
