"""Scene files to start from."""

from __future__ import annotations

import shlex
from pathlib import Path

from ..core.errors import SceneError
from ..core.files import atomic_write, scene_templates
from ..core.registry import did_you_mean


def write_template(kind: str, target: Path, *, overwrite: bool = False) -> None:
    """Write the shipped scene called ``kind`` to the file ``target``, which the commands in its comments name.

    Raises SceneError for an unknown kind, and where the file exists and ``overwrite`` does not allow replacing it.
    """
    known = scene_templates()
    if kind not in known:
        raise SceneError(f"unknown scene {kind!r}{did_you_mean(kind, list(known))} (known: {', '.join(known)})")
    if target.exists() and not overwrite:
        raise SceneError(f"{target} exists; choose another name or add --overwrite")
    path, text = shlex.quote(str(target)), known[kind].read_text(encoding="utf-8")
    with atomic_write(target) as stream:
        stream.write(f"# Look at it:  wakeflow plan {path}    Compute it:  wakeflow run {path}\n")
        stream.write(text.replace(f"wakeflow run cases/{kind}.toml", f"wakeflow run {path}"))
