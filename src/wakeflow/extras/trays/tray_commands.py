"""The commands around measured shares: calibrate, protocol; and the comparison of a run with them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ...cli.options import GATE, Folder, Gate, Quiet, Settings, Threads, scene_and_folder
from ...core.errors import SceneError
from ...scene.overrides import share_of

Missed = Annotated[
    float | None,
    Parameter(
        help="Half of the 95 % interval by which the model itself may miss a share of a half; default 2 points.",
        converter=lambda _, tokens: share_of(tokens[0].value),
    ),
]


def calibrate(
    scene: Path,
    measured: Path,
    *,
    out: Folder = None,
    settings: Settings = (),
    gate: Gate = GATE,
    discrepancy: Missed = None,
    workers: Threads = None,
    quiet: Quiet = False,
) -> None:
    """Say what measured shares tell of the numbers that a scene does not say exactly, and of all its shares.

    Prints the shares before and after, which numbers became narrower, whether measurement and model agree, which tray
    told most and what to measure next; writes inputs.csv, shares.csv, agreement.csv, a picture, and materials.toml for
    the next scene. Where they disagree no materials are written.

    Parameters
    ----------
    scene
        A scene file, run where it has not been.
    measured
        A CSV file: fraction,bin,share,uncertainty. Share from 0 to 1, or the column mass or count; an empty fraction is
        a tray that was not sorted.
    """
    from ...runs.progress import live
    from .calibration import calibrate as find
    from .calibration_update import DISCREPANCY
    from .show_trays import show_calibration

    given, folder = scene_and_folder(scene, settings, gate, out)
    with live(enabled=not quiet) as listener:
        calibration = find(
            given, measured, folder, discrepancy=DISCREPANCY if discrepancy is None else discrepancy, workers=workers,
            listener=listener, planned=listener.planned, **gate.how,
        )  # fmt: skip
    if not quiet:
        show_calibration(calibration)


def protocol(
    scene: Path,
    *,
    of: Annotated[
        str | None, Parameter(help="What to know better: FRACTION, its recovery, or FRACTION.BIN; default the worst.")
    ] = None,
    kernels: Annotated[int, Parameter(help="Kernels of a fraction that you count in one repetition.")] = 300,
    out: Folder = None,
    settings: Settings = (),
    gate: Gate = GATE,
    workers: Threads = None,
    quiet: Quiet = False,
) -> None:
    """Say what to weigh: which trays, how many kernels and how often, until the interval of a share is half as wide.

    Writes protocol.html, a page to print with the drawing of the machine, and measured.csv, the form that it fills.

    Parameters
    ----------
    scene
        A scene file, run where it has not been, or the folder of a finished run.
    """
    from ...answer.result import Result
    from ...runs.progress import live
    from .protocol import protocol as plan_trays
    from .protocol import protocol_of
    from .show_trays import show_protocol

    if scene.is_dir():
        if settings or gate != GATE:
            raise SceneError("a finished run has its numbers, rung and terms; give its scene file to change them")
        made = protocol_of(Result.load(scene), of or "", kernels, out)
        if not quiet:
            show_protocol(made)
        return
    given, folder = scene_and_folder(scene, settings, gate, out)
    with live(enabled=not quiet) as listener:
        made = plan_trays(
            given, folder, of=of, kernels=kernels, workers=workers, listener=listener, planned=listener.planned,
            **gate.how,
        )  # fmt: skip
    if not quiet:
        show_protocol(made)
