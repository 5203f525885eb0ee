"""Write an OpenFOAM case: the template as it is, and one small file of parameters."""

from __future__ import annotations

import math
import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FoamError, SceneError
from ..core.files import atomic_write
from ..core.resources import case_template
from ..laws.constants import C_MU
from ..meshing import MeshSpec
from .polymesh import read_polymesh
from .vibration import Vibration

__all__ = [
    "SETTINGS",
    "FlowSpec",
    "Stream",
    "axis_points",
    "environment",
    "set_patch_types",
    "write_case",
    "write_inlets",
    "write_parameters",
]

PARAMETERS, INLETS, FORCES = Path("system", "parameters"), Path("system", "inlets"), Path("system", "forces")
INSTALL = "run: sh cases/setup.sh (or, as root, apt-get install openfoam)"
MIXING_LENGTH = 0.07  # of the channel width: fully developed duct flow
LONGEST_STEP = 0.05  # convective times: about 100 steps a shedding period where the Courant number allows more
WAKE_PROBES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # projected widths behind the first body: a steady run's velocities


# What the template knows: largest Courant number of a time-resolved run, and its share of the one asked for
SETTINGS = {"normal": (math.inf, 1.0), "careful": (1.0, 0.5), "first-order": (0.5, 0.25)}


# Solutions of velocity and pressure in a time step. Laminar: one made a square's lift 15 % and its drag 1.5 % too
# large at Re 100. k-omega SST: with one, half the Courant number moved a rhombus' Cd by 1.5 % and its lift by 2 %, at
# twice the cost.
CORRECTORS = {"laminar": 2, "kOmegaSST": 1}
# Convection of a time-resolved velocity. LUST is three parts central to one of linearUpwind: on a cylinder's wake at
# Re 100 (DFG 2D-2, 4.4k cells) it took the error of mean Cd from 5 to 2 % and that of Cl's rms from 19 to 4 %. With
# k-omega SST cells are too coarse for central differences.
CONVECTION = {"laminar": "LUST grad(U)", "kOmegaSST": "linearUpwind grad(U)"}


@dataclass(frozen=True)
class Stream:
    """A secondary air stream through the patch ``inlet_NAME`` of a wall: ``velocity`` (m/s) into the channel, uniform
    over the opening of ``width`` (m)."""

    name: str
    side: Literal["left", "right"]
    width: float
    velocity: float


@dataclass(frozen=True)
class FlowSpec:
    """Air through a meshed channel: ``speed`` (m/s, inlet mean), ``density`` (kg/m3), ``viscosity`` (dynamic, Pa s),
    ``intensity`` (u'/U at the inlet; not used when laminar), ``profile`` of the inlet's velocity (parabolic: fully
    developed laminar channel flow, 3/2 of the mean in the middle), ``inlets``: secondary streams. ``vibration``: of
    bodies and mesh along the channel; None: the bodies are at rest in the air. ``settings``: one of SETTINGS, where the
    ladder of safer ones starts; ``ranks``: MPI processes. ``accuracy``: relative half-width of the 95 % intervals at
    which a time-resolved run ends, see :func:`wakeflow.foam.statistics.wanted`."""

    mesh: MeshSpec
    speed: float
    density: float
    viscosity: float
    turbulence: Literal["laminar", "kOmegaSST"]
    stepping: Literal["steady", "time-resolved"] = "steady"
    intensity: float = 0.05
    max_courant: float = 4.0
    accuracy: float = 0.02
    profile: Literal["uniform", "parabolic"] = "uniform"
    inlets: tuple[Stream, ...] = ()
    settings: str = "normal"
    ranks: int = 1
    vibration: Vibration | None = None

    def __post_init__(self) -> None:
        if self.stepping == "time-resolved" and self.mesh.half:
            raise SceneError(
                "a time-resolved airflow sheds vortices to both sides: it needs a mesh of the whole channel"
            )
        if self.stepping == "steady" and self.vibration is not None:
            raise SceneError("a steady airflow cannot follow a vibrating body: use rung standard")

    @property
    def reynolds(self) -> float:
        """On the first body's projected width and the inlet speed."""
        return self.speed * self.mesh.projected_width * self.density / self.viscosity

    @property
    def convective_time(self) -> float:
        """Projected width over inlet speed (s)."""
        return self.mesh.projected_width / self.speed

    @property
    def along(self) -> float:
        """+1 for air flowing towards +y, -1 for -y."""
        return 1.0 if self.mesh.direction == "up" else -1.0

    def incoming(self, speed: float, width: float) -> tuple[float, float]:
        """k (m2/s2) and omega (1/s) of air entering at ``speed`` (m/s) through an opening of ``width`` (m).

        k = 3/2 (I U)^2, omega = sqrt(k)/(C_mu^(1/4) l) with l = 0.07 of the width, the usual estimate for fully
        developed duct flow.
        """
        k = 1.5 * (self.intensity * speed) ** 2
        return k, k**0.5 / (C_MU**0.25 * MIXING_LENGTH * width)

    def parameters(self) -> dict[str, str | float | int]:
        """Everything the template leaves open, by the names in system/parameters.

        The coefficients' area counts the meshed part of the body only, so that a half domain gives the full body's
        coefficients.
        """
        k, omega = self.incoming(self.speed, self.mesh.width)
        spec = self.mesh
        most, share = SETTINGS[self.settings]
        middle, _, rear = axis_points(self)
        size, depth = spec.projected_width, 0.5 * spec.thickness
        behind = [self.along * (rear + distance * size) for distance in WAKE_PROBES]
        swing = self.vibration.parameters() if self.vibration is not None else {}
        longest = LONGEST_STEP * self.convective_time
        return {
            "stepping": self.stepping,
            "turbulence": self.turbulence,
            "walls": "slip" if spec.walls == "slip" else "noSlip",
            "inletVelocity": f"(0 {self.along * self.speed:.12g} 0)",
            "inletSpeed": self.speed,
            "flowDirection": f"(0 {self.along:g} 0)",
            "nu": self.viscosity / self.density,
            "inletK": k,
            "inletOmega": omega,
            "bodyWidth": spec.projected_width,
            "bodyArea": spec.projected_width * spec.thickness * (0.5 if spec.half else 1.0),
            "basePoint": f"({middle:.9g} {self.along * rear:.9g} {depth:.9g})",
            "wakePoints": "(" + " ".join(f"({middle + 0.01 * size:.9g} {y:.9g} {depth:.9g})" for y in behind) + ")",
            "settings": self.settings,
            "convection": CONVECTION[self.turbulence],
            "correctors": CORRECTORS[self.turbulence],
            "maxCo": min(most, share * self.max_courant),
            "ranks": self.ranks,
            **swing,
            "maxDeltaT": min(longest, float(swing.get("maxDeltaT", longest))),
        }


def axis_points(spec: FlowSpec) -> tuple[float, float, float]:
    """x of the first body's middle; where that vertical line meets its front and rear, along the air (m)."""
    outline = np.array(spec.mesh.bodies[0])
    middle = float(outline[:, 0].min() + outline[:, 0].max()) / 2
    start, end = outline, np.roll(outline, -1, axis=0)
    met = []
    for (x0, y0), (x1, y1) in zip(start, end, strict=True):
        if min(x0, x1) <= middle <= max(x0, x1):
            met += [y0, y1] if x0 == x1 else [y0 + (middle - x0) * (y1 - y0) / (x1 - x0)]
    along = spec.along * np.array(met)
    return middle, float(along.min()), float(along.max())


def environment() -> dict[str, str]:
    """The environment every OpenFOAM program of Debian's package needs: nothing to source."""
    return {**os.environ, "WM_PROJECT_DIR": "/usr/share/openfoam", "OMP_NUM_THREADS": "1", "FOAM_SIGFPE": "true"}


def write_case(spec: FlowSpec, folder: Path) -> None:
    """Copy the template into ``folder`` and set its parameters; an existing case keeps its mesh, times and history."""
    shutil.copytree(case_template(), folder, dirs_exist_ok=True)
    write_parameters(folder, spec.parameters())
    write_inlets(spec, folder)
    names = spec.mesh.names if len(spec.mesh.names) > 1 else ()
    entries = "".join(f'drag_{name}\n{{\n    $forceCoefficients;\n    patches ("body_{name}");\n}}\n' for name in names)
    with atomic_write(folder / FORCES) as out:
        out.write((case_template() / FORCES).read_text() + entries)


def write_parameters(folder: Path, values: Mapping[str, str | float | int]) -> None:
    """Change values in ``system/parameters``, keeping its comments. Raises FoamError for a name it does not hold."""
    path = folder / PARAMETERS
    text = path.read_text()
    for name, value in values.items():
        words = f"{value:.12g}" if isinstance(value, float) else str(value)
        entry = re.compile(rf"^({name}\s+)[^;]*;", re.M)
        text, count = entry.subn(rf"\g<1>{words};", text, count=1)
        if count != 1:
            raise FoamError(f"the case template has no parameter {name!r} in {path}")
    with atomic_write(path) as stream:
        stream.write(text)


def write_inlets(spec: FlowSpec, folder: Path) -> None:
    """Write ``system/inlets``, what enters where; a parabolic profile once the case has its mesh.

    Each face of the inlet gets the profile's mean over it, so that the flow rate is exact on every mesh:
    u = 3/2 U (1 - (2 x / W)^2), laminar flow between plates.
    """
    velocity = f"uniform (0 {spec.along * spec.speed:.12g} 0)"
    if spec.profile == "parabolic" and (folder / "constant" / "polyMesh" / "boundary").exists():
        velocity = _list_of_vectors(0.0, spec.along * _parabola(spec, folder))
    rows = {"inletsU": {"inlet": velocity}, "inletsK": {}, "inletsOmega": {}}
    for stream in spec.inlets:
        k, omega = spec.incoming(stream.velocity, stream.width)
        inward = stream.velocity if stream.side == "left" else -stream.velocity
        patch = f"inlet_{stream.name}"
        rows["inletsU"][patch] = f"uniform ({inward:.12g} 0 0)"
        rows["inletsK"][patch], rows["inletsOmega"][patch] = f"uniform {k:.12g}", f"uniform {omega:.12g}"
    path = folder / INLETS
    head = path.read_text().split("\ninletsU", 1)[0]
    with atomic_write(path) as out:
        out.write(head)
        for name, patches in rows.items():
            entries = "".join(f"    {patch} {{ type fixedValue; value {v}; }}\n" for patch, v in patches.items())
            out.write(f"\n{name}\n{{\n{entries}}}\n")


def _parabola(spec: FlowSpec, folder: Path) -> NDArray[np.float64]:
    """Mean speed (m/s) over every face of the patch ``inlet``, in the patch's order."""
    plane = read_polymesh(folder).plane
    x = 2.0 * plane.points[plane.faces[plane.on("inlet")], 0] / spec.mesh.width
    a, b = x.T
    return np.asarray(1.5 * spec.speed * (1.0 - (a * a + a * b + b * b) / 3.0))  # mean of x^2 over [a, b]


def _list_of_vectors(x: float, y: NDArray[np.float64]) -> str:
    return f"nonuniform List<vector> {len(y)}(" + " ".join(f"({x:.12g} {value:.12g} 0)" for value in y) + ")"


def set_patch_types(folder: Path, *, walls: str) -> None:
    """Give every patch in ``constant/polyMesh/boundary`` its type: gmshToFoam makes all of them plain patches."""
    path = folder / "constant" / "polyMesh" / "boundary"

    def kind(name: str) -> str:
        if name in ("front", "back"):
            return "empty"
        if name == "axis":
            return "symmetryPlane"
        solid = name.startswith("body_") or (name in ("left", "right") and walls == "no-slip")
        return "wall" if solid else "patch"

    def entry(match: re.Match[str]) -> str:
        body = re.sub(r"\n\s*physicalType[^\n]*", "", match[2])
        return match[1] + re.sub(r"type\s+\w+;", f"type            {kind(match[1].split()[0])};", body, count=1)

    text = re.sub(r"(^    [\w-]+\n    )(\{.*?\n    \})", entry, path.read_text(), flags=re.M | re.S)
    with atomic_write(path) as stream:
        stream.write(text)
