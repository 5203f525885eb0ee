"""What moves: the page's own script, the film of a finished run, the window on a machine.

Comes in: an outcome of a run, or its folder. Goes out: parts of report.html, a GIF or MP4, a window.
May call it: the command line; ``show.outcome`` has the registry of what is added to the page.
"""

COMMANDS = (
    "wakeflow.extras.motion.motion_commands:view",
    "wakeflow.extras.motion.motion_commands:animate",
)


def register() -> None:
    """Add the parts of the page, in their order."""
    from ...show.outcome import PageAddition, page_additions
    from .film import FILMS, film_part
    from .live import watch_part

    page_additions.add("watch", PageAddition(watch_part))
    page_additions.add("film", PageAddition(film_part, FILMS))
