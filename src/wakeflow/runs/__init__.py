"""run(): a scene's stages, its budget and its report, in one folder; and what is made of a finished run.

Comes in: a scene file or a Scene, and what a run may cost. Goes out: a folder with result.json, and its Result.
May call it: a user (``wf.run``, ``wf.plan``, ``wf.chain``), ``many``, the command line, extras.
"""

from ..flight.stages.compilation import compile_tracker
from .folder import answer_key, versions
from .one_run import report_again, run, run_once

__all__ = ["answer_key", "compile_tracker", "report_again", "run", "run_once", "versions"]
