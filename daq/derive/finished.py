"""Keeps the session of a campaign that is over under a name that is written once."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path

from ..files import rewritten, sync_folder

FOLDER = "finished"


def keep_finished(session: Path) -> None:
    """Give a session file a second name in the folder `finished` next to it.

    Who builds the session again replaces the first name; the file with the second one stays.
    It takes no room where the file system knows hard links.  Failing to is no error of the session:
    it is done when the session is built again.
    """
    final = session.parent / FOLDER / session.name
    with suppress(OSError):
        final.parent.mkdir(exist_ok=True)
        try:
            os.link(session, final)
            sync_folder(final.parent)
        except FileExistsError:
            return
        except OSError:  # a memory card
            with rewritten(final) as part:
                shutil.copyfile(session, part)
