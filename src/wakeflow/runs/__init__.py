"""run(): a scene's stages, its budget and its report, in one folder; and what is made of a finished run."""

from .again import film_of, report_again
from .folder import answer_key, versions
from .one_run import run, run_once

__all__ = ["answer_key", "film_of", "report_again", "run", "run_once", "versions"]
