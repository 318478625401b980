"""Checks a bench, and proposes a bench from the traffic on the bus."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .answers import HINTS as HINTS
    from .answers import NO_ANSWERS as NO_ANSWERS
    from .answers import Answers as Answers
    from .answers import Question as Question
    from .check import CheckReport as CheckReport
    from .check import check_bench as check_bench
    from .check import part_of as part_of
    from .frame_checks import mixed_messages as mixed_messages
    from .marks import open_questions as open_questions
    from .propose import Proposal as Proposal
    from .propose import propose_sensors as propose_sensors
    from .propose_columns import propose_map as propose_map
    from .push_test import ORDER as ORDER
    from .push_test import PushResult as PushResult
    from .push_test import judge_push as judge_push
    from .push_test import shows_push as shows_push
    from .push_test import spoken as spoken
    from .result import WORDS as WORDS
    from .signs import opposed_signs as opposed_signs
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
