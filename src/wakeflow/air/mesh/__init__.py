"""The mesh: a two-dimensional Gmsh mesh of the channel around the bodies, extruded by one layer for OpenFOAM.

A scene's outlines become a :class:`MeshSpec` (``sizing``), that a list of points with the cell edge wanted there
(``zones``) and the nodes on the outlines (``outline``), that a Gmsh model (``gmsh_child``). Gmsh is one global object
that no two threads may touch: :func:`build_mesh` runs it in a process of its own and reads the ``.msh`` file through
meshio (``quality``). The same spec always gives the same mesh.
"""

from .sizing import ends, plan_mesh
from .spec import MeshReport, MeshSpec, SideInlet, build_mesh, read_mesh

__all__ = ["MeshReport", "MeshSpec", "SideInlet", "build_mesh", "ends", "plan_mesh", "read_mesh"]
