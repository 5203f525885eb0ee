"""The mesh: a two-dimensional Gmsh mesh of the channel around the bodies, extruded by one layer for OpenFOAM.

Comes in: outlines, as a :class:`MeshSpec` (``sizing``, ``outline``). Goes out: a ``.msh`` file and its MeshReport.
May call it: ``foam`` and ``kinds``. Gmsh is one global object that no two threads may touch: :func:`build_mesh` runs it
(``gmsh_child``) in a process of its own. The same spec always gives the same mesh.
"""

from .sizing import ends, plan_mesh
from .spec import MeshReport, MeshSpec, SideInlet, build_mesh, read_mesh

__all__ = ["MeshReport", "MeshSpec", "SideInlet", "build_mesh", "ends", "plan_mesh", "read_mesh"]
