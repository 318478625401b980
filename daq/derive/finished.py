"""Keeps the session of a finished campaign under a second name that is never replaced."""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from pathlib import Path

from ..files import rewritten, sync_folder

FOLDER = "finished"


def keep_finished(session: Path) -> None:
    """Give a session file a second name in the folder `finished` next to it.

    Building the session again replaces only the file with the first name.  The second name takes no
    space on file systems with hard links.  A failure is not an error of the session: it is tried
    again when the session is built again.
    """
    final = session.parent / FOLDER / session.name
    with suppress(OSError):
        final.parent.mkdir(exist_ok=True)
        try:
            os.link(session, final)
            sync_folder(final.parent)
        except FileExistsError:
            return
        except OSError:  # for example on a memory card
            with rewritten(final) as part:
                shutil.copyfile(session, part)
