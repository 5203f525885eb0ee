"""The pictures of the paper, which a scene asks for by [picture.NAME]: curves, maps, levels.

Comes in: an outcome of a run and the picture's table.
Goes out: a PNG, its data as CSV, its numbers.
May call it: nobody by name; ``show.asked_pictures`` has the registry of pictures.
"""


def register() -> None:
    """Add every kind under the name of its table."""
    from ...show.asked_pictures import pictures
    from .granule_curves import draw_curves
    from .levels import draw_levels
    from .maps import draw_density, draw_streamlines

    pictures.add("curves", draw_curves)
    pictures.add("streamlines", draw_streamlines)
    pictures.add("density", draw_density)
    pictures.add("levels", draw_levels)
