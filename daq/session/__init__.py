"""Builds a session from a journal, logs or tables; writes and reads its file, HDF5.

`schema.txt` describes the file; ``bumpbench validate --schema`` prints it.
"""

from .reading import finding_document as finding_document
from .reading import read_session as read_session
from .reading import validate_session as validate_session
from .writing import write_session as write_session
