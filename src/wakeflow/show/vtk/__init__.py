"""What ParaView opens: the air in time and in the mean, the machine, tracks, granules on their way, and landings.

Lengths in m, y up, z = 0; units are in the names of the arrays. Binary XML; places and values in single precision.
Nothing is drawn here, so no OpenGL is needed.
"""

from .vtk_files import clear_pieces, pieces, write_field, write_machine
from .vtk_tracks import write_landings, write_moving, write_tracks

__all__ = [
    "FILES", "clear_pieces", "pieces", "write_field", "write_landings", "write_machine", "write_moving", "write_tracks",
]  # fmt: skip

# what the functions here leave in a run's folder, besides the pieces that the indices among them name
FILES = ("field.npz", "field.vtu", "field.pvd", "mean.vtu", "machine.vtm", "tracks.vtp", "granules.pvd", "landings.vtp")
