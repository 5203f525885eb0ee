"""Every package that wakeflow and its tests need, as installed here, with its licence: ``python tests/dependencies.py``
writes requirements.lock, which set-up installs.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.lock"
# GPL-3.0-or-later is this program's: what is linked or imported must allow to be passed on under it
COMPATIBLE = re.compile(
    r"\b(MIT|BSD|0BSD|ISC|Apache|PSF|Python|MPL|Mozilla|Zlib|HPND|CC0|Unlicense|LGPL|GPL-3|GPLv3|GPLv2\+|PIL|Boost|WTFPL|"
    r"GPL-2.0-or-later|GPL|GNU)\b", re.I,
)  # fmt: skip
SAME = (  # what distributions call the same licence
    (r"Apache Software License|Apache 2\.0", "Apache-2.0"), (r"BSD License", "BSD"), (r"DFSG approved; ", ""),
    (r"MIT License", "MIT"), (r"ISC License \(ISCL\)", "ISC"), (r"Mozilla Public License 2\.0 \(MPL 2\.0\)", "MPL-2.0"),
    (r"Python Software Foundation License", "PSF-2.0"),
)  # fmt: skip
HEAD = "# Written by tests/dependencies.py on Python {python}: the versions that the tests passed with.\n"


def needed(name: str = "wakeflow-separation", extras: frozenset[str] = frozenset({"test"})) -> dict[str, Distribution]:
    """The distributions of a package with ``extras`` and of all that these need here, by their names."""
    found: dict[str, Distribution] = {}
    ahead, seen = [(name, extras)], set()
    while ahead:
        one, wanted = ahead.pop()
        if (one, wanted) in seen:
            continue
        seen.add((one, wanted))
        try:
            made = distribution(one)
        except PackageNotFoundError:  # of an extra that is not installed
            continue
        found[canonicalize_name(made.name)] = made
        ahead += [(canonicalize_name(part.name), frozenset(part.extras)) for part in _asked(made, wanted)]
    return dict(sorted(found.items()))


def _asked(made: Distribution, extras: frozenset[str]) -> Iterator[Requirement]:
    for text in made.requires or ():
        part = Requirement(text)
        if part.marker is None or any(part.marker.evaluate({"extra": extra}) for extra in (*extras, "")):
            yield part


def licence_of(made: Distribution) -> str:
    """What a distribution says of its licence, in a few words."""
    about = made.metadata
    classified = [one.rpartition(":: ")[2] for one in about.get_all("Classifier") or () if one.startswith("License ::")]
    said = about.get("License-Expression") or "; ".join(classified) or (about.get("License") or "").strip()
    said = said.splitlines()[0][:60] if said else "not said"
    for names, name in SAME:
        said = re.sub(names, name, said)
    return said


def main() -> None:
    lines = [f"{name}=={made.version}  # {licence_of(made)}\n" for name, made in needed().items() if name != "wakeflow"]
    LOCK.write_text(HEAD.format(python=".".join(map(str, sys.version_info[:2]))) + "".join(lines))


if __name__ == "__main__":
    main()
