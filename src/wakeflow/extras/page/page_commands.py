"""The command of the page: open."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from ...core.errors import SceneError


def open_(
    what: Path | None = None,
    *,
    browser: Annotated[bool, Parameter(negative="--no-browser", help="Open it in the browser too.")] = True,
    port: Annotated[
        int | None, Parameter(validator=Number(gte=0, lte=65535), help="Instead of the first free one.")
    ] = None,
) -> None:
    """Work with the mouse: drag the machine, see its plan, run it, look at results, on a page in the browser.

    Prints the page's address. It is served on this machine alone until Ctrl-C, or until it is closed and all runs that
    were asked for are done.

    Parameters
    ----------
    what
        A scene file, the folder of a finished run, or a folder with scenes and runs; default a rhombus to start from.
    """
    from importlib.util import find_spec

    if find_spec("tornado") is None:
        raise SceneError("the page needs tornado: pip install 'wakeflow-separation[page]', or sh cases/setup.sh")
    from .server import PORTS, open_page

    ports = PORTS if port is None else [port]
    open_page(what, ports=ports, browser=browser, ready=lambda address: print(address, flush=True))
