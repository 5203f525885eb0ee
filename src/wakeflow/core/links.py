"""Files of the cache shown elsewhere without a second copy on the disk."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

__all__ = ["link_or_copy"]

CANNOT = (errno.EXDEV, errno.EPERM, errno.EMLINK, errno.ENOTSUP, errno.EACCES)  # another disk, or one without links


def link_or_copy(source: Path, target: Path) -> None:
    """Show the file ``source`` as ``target`` too: a hard link, or a copy where the file system has none.

    ``target`` appears whole and replaces what stood there. The two are one file afterwards: replace it, as every writer
    of this package does, and do not change it in place.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = target.with_name(f".{target.name}.tmp")
    draft.unlink(missing_ok=True)
    try:
        try:
            os.link(source, draft)
        except OSError as problem:
            if problem.errno not in CANNOT:
                raise
            shutil.copyfile(source, draft)
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)
