"""What may make an answer wrong and how far: one file a source of error, or a family.

Comes in: a Pipeline whose granules flew. Goes out: columns of the joint draws, rows of the budget, verdicts on limits.
May call it: ``runs`` and those after it; the plan is handed the sources. Every module of this folder is imported with
it, so that its sources are registered.
"""

from importlib import import_module
from pkgutil import iter_modules

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
