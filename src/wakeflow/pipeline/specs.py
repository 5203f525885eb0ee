"""What a scene asks of Gmsh and OpenFOAM under its plan."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.errors import known
from ..laws.turbulence import USUAL, turbulence_models
from ..planning.plan import Plan
from ..scene import Scene

if TYPE_CHECKING:
    from ..foam import FlowSpec
    from ..meshing import MeshSpec


def mesh_spec(scene: Scene, plan: Plan, grid: int = 0) -> MeshSpec:
    """What the plan wants meshed, on one of its grids."""
    from ..meshing import SideInlet, plan_mesh

    channel, air = scene.channel, scene.air
    assert air is not None
    return plan_mesh(
        [body.outline() for body in scene.body.values()],
        width=channel.width,
        top=channel.top,
        bottom=channel.bottom,
        names=list(scene.body),
        walls=channel.walls,
        direction=air.direction,
        rung="standard" if plan.airflow.stepping == "time-resolved" else "draft",
        scale=scene.numerics.mesh_scale * plan.airflow.scales[grid],
        inlets=[SideInlet(name, inlet.side, *inlet.span) for name, inlet in channel.inlet.items()],
        extend=channel.extend and air.case is None,
        half=plan.airflow.half,
    )


def flow_spec(scene: Scene, plan: Plan, mesh: MeshSpec) -> FlowSpec:
    """The airflow that the plan wants through a mesh, or that a given case must be."""
    from ..foam import FlowSpec, Stream
    from ..foam.mesh_motion import MeshMotion

    air, how = scene.air, plan.airflow
    amplitude, omega = scene.motion
    assert air is not None
    return FlowSpec(
        mesh=mesh,
        speed=air.speed,
        density=air.density,
        viscosity=air.viscosity,
        turbulence=known(how.turbulence) if known(how.turbulence) in turbulence_models else USUAL,
        stepping=how.stepping or "steady",
        intensity=air.turbulence,
        profile=air.profile,
        inlets=tuple(
            Stream(name, inlet.side, inlet.width, inlet.velocity) for name, inlet in scene.channel.inlet.items()
        ),
        accuracy=how.accuracy,
        ranks=0 if scene.numerics.ranks == "auto" else scene.numerics.ranks,
        vibration=MeshMotion(float(amplitude[1]), omega) if how.moving else None,
        span=how.span,
    )
