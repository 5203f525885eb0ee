"""The command that examines: doctor."""

from __future__ import annotations

import json

from ...cli.options import AsJson


def doctor(*, as_json: AsJson = False) -> int:
    """Try in small what a run does; say which versions did it, and the command that mends what fails.

    Parameters
    ----------
    as_json
        Print JSON.
    """
    from dataclasses import asdict

    from rich.console import Console

    from .examination import examine, exit_code, table

    with Console(stderr=True).status("trying what a run does; the tracker's first compilation takes a minute or two"):
        findings = examine()
    if as_json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        Console().print(table(findings))
    return exit_code(findings)
