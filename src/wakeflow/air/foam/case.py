"""Write an OpenFOAM case: the template as it is, and one small file of parameters."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FoamError, SceneError
from ...core.files import atomic_write, case_template
from ...laws.span import Span
from ...laws.turbulence import USUAL, TurbulenceField, TurbulenceModel, entering_energy, turbulence_models
from ..mesh import MeshSpec
from .polymesh import read_polymesh

SNAPSHOTS = 12  # a vibration, at least: the field between them is interpolated
ROUND_OFF = 1e-6  # rad: of a time that is meant to be whole vibrations
STEPS = 48  # time steps a vibration period, at least: a second-order step follows the motion to 0.3 % there


@dataclass(frozen=True)
class MeshMotion:
    """Harmonic motion of bodies and mesh along the channel: d(t) = (0, ``amplitude`` sin(``omega`` t)).

    ``amplitude`` m, ``omega`` rad/s, t the case's own clock (s). The ends of the channel move with the mesh: where air
    comes in uniform and leaves undisturbed, that changes nothing.
    """

    amplitude: float
    omega: float

    @property
    def period(self) -> float:
        """Length of a vibration (s)."""
        return 2.0 * math.pi / self.omega

    @property
    def peak_speed(self) -> float:
        """Largest speed of the body, a w (m/s)."""
        return self.amplitude * self.omega

    def displacement(self, time: float) -> float:
        """Where the mesh is at ``time`` (s), along y from its reference position (m)."""
        return self.amplitude * math.sin(self.omega * time)

    def speed(self, time: float) -> float:
        """Velocity of the mesh along y at ``time`` (s), in m/s."""
        return self.amplitude * self.omega * math.cos(self.omega * time)

    def cadence(self, longest: float) -> float:
        """Time between snapshots (s): at most ``longest``, a whole number of at least SNAPSHOTS a vibration."""
        return self.period / max(SNAPSHOTS, math.ceil(self.period / longest - 1e-9))

    def motion(self, begin: float) -> dict[str, list[float] | float]:
        """The motion against a clock that starts at ``begin`` (s): amplitude (x, y) m, omega rad/s, phase rad.

        Displacement at time t of that clock: amplitude sin(omega t + phase).
        """
        phase = math.remainder(self.omega * begin, 2.0 * math.pi)
        phase = 0.0 if abs(phase) < ROUND_OFF else phase
        return {"amplitude": [0.0, self.amplitude], "omega": self.omega, "phase": phase}

    def parameters(self) -> dict[str, str | float]:
        """What the case template leaves open for a moving mesh."""
        return {
            "bodyWall": "movingWallVelocity",
            "amplitude": self.amplitude,
            "omega": self.omega,
            "maxDeltaT": self.period / STEPS,
        }


PARAMETERS, INLETS, FORCES = Path("system", "parameters"), Path("system", "inlets"), Path("system", "forces")
MODELS = "turbulence-models"  # in the template: a folder a model, its files go over those of the template's own
INSTALL = "as root: apt-get install --no-install-recommends openfoam"
LONGEST_STEP = 0.05  # convective times: about 100 steps a shedding period where the Courant number allows more
WAKE_PROBES = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # projected widths behind the first body: a steady run's velocities


# What the template knows: largest Courant number of a time-resolved run, and its share of the one asked for
SETTINGS = {"normal": (math.inf, 1.0), "careful": (1.0, 0.5), "first-order": (0.5, 0.25)}


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
    ``turbulence``: one of ``laws.turbulence``; ``intensity`` (u'/U at the inlet; not used when laminar),
    ``profile`` of the inlet's velocity (parabolic: fully developed laminar channel flow, 3/2 of the mean in the
    middle), ``inlets``: secondary streams. ``vibration``: of bodies and mesh along the channel; None: the bodies are at
    rest in the air. ``settings``: one of SETTINGS, where the ladder of safer ones starts; ``ranks``: MPI processes,
    0: not decided yet. ``accuracy``: relative half-width of the 95 % intervals at which a time-resolved run ends, see
    :func:`wakeflow.air.foam.statistics.wanted`."""

    mesh: MeshSpec
    speed: float
    density: float
    viscosity: float
    turbulence: str
    stepping: Literal["steady", "time-resolved"] = "steady"
    intensity: float = 0.05
    max_courant: float = 4.0
    accuracy: float = 0.02
    profile: Literal["uniform", "parabolic"] = "uniform"
    inlets: tuple[Stream, ...] = ()
    settings: str = "normal"
    ranks: int = 1
    vibration: MeshMotion | None = None

    def __post_init__(self) -> None:
        """Raise SceneError for a model that is not known, and for what the stepping cannot follow."""
        _ = self.model
        if self.stepping == "time-resolved" and self.mesh.half:
            raise SceneError(
                "a time-resolved airflow sheds vortices to both sides: it needs a mesh of the whole channel"
            )
        if self.stepping == "steady" and self.vibration is not None:
            raise SceneError("a steady airflow cannot follow a vibrating body: use rung standard")
        if self.ranks > 1 and self.vibration is not None:
            raise SceneError("numerics.ranks: an airflow round a vibrating body runs as one process; leave it out")

    @property
    def reynolds(self) -> float:
        """Reynolds number on the first body's projected width and the inlet speed."""
        return self.speed * self.mesh.projected_width * self.density / self.viscosity

    @property
    def convective_time(self) -> float:
        """Projected width over inlet speed (s)."""
        return self.mesh.projected_width / self.speed

    @property
    def along(self) -> float:
        """+1 for air flowing towards +y, -1 for -y."""
        return 1.0 if self.mesh.direction == "up" else -1.0

    @property
    def model(self) -> TurbulenceModel:
        """The turbulence model's record. Raises SceneError where none has that name."""
        return turbulence_models[self.turbulence]

    @property
    def transported(self) -> tuple[TurbulenceField, ...]:
        """The turbulent fields that the case folder holds in 0/ with a value on the inlet: those of the template's
        own model, which stay unread under another one, then the model's further ones.
        """
        both = (*turbulence_models[USUAL].transported, *self.model.transported)
        return tuple({field.name: field for field in both}.values())

    def entering(self, speed: float, width: float) -> dict[TurbulenceField, float]:
        """The turbulent fields (SI) of air entering at ``speed`` (m/s) through an opening of ``width`` (m)."""
        k = entering_energy(self.intensity, speed)
        return {field: field.entering(k, width) for field in self.transported}

    def parameters(self) -> dict[str, str | float | int]:
        """Everything the template leaves open, by the names in system/parameters.

        The coefficients' area counts the meshed part of the body only, so that a half domain gives the full body's
        coefficients.
        """
        spec, model = self.mesh, self.model
        inlet = self.entering(self.speed, spec.width)
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
            **{field.inlet: inlet[field] for field in turbulence_models[USUAL].transported},
            "bodyWidth": spec.projected_width,
            "bodyArea": spec.projected_width * spec.thickness * (0.5 if spec.half else 1.0),
            "basePoint": f"({middle:.9g} {self.along * rear:.9g} {depth:.9g})",
            "wakePoints": "(" + " ".join(f"({middle + 0.01 * size:.9g} {y:.9g} {depth:.9g})" for y in behind) + ")",
            "settings": self.settings,
            "convection": model.convection,
            "correctors": model.correctors,
            "maxCo": min(most, share * self.max_courant),
            "ranks": self.ranks,
            **swing,
            "maxDeltaT": min(longest, float(swing.get("maxDeltaT", longest))),
        }


@dataclass(frozen=True)
class SpanSpec(FlowSpec):
    """Air through a meshed channel in three dimensions (``air.foam.spanwise.span_run``), over a ``span``."""

    _: KW_ONLY
    span: Span

    @property
    def plane(self) -> FlowSpec:
        """The plane wake, of the usual turbulence model, that it starts from."""
        parts = {name: value for name, value in vars(self).items() if name != "span"}
        return FlowSpec(**{**parts, "turbulence": USUAL, "ranks": 1})


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


def write_case(spec: FlowSpec, folder: Path) -> None:
    """Copy the template into ``folder``, the turbulence model's own files over it, and set its parameters; an existing
    case keeps its mesh, times and history.

    Raises FoamError where the template lacks a field of the model.
    """
    shutil.copytree(case_template(), folder, ignore=shutil.ignore_patterns(MODELS), dirs_exist_ok=True)
    of_model = case_template() / MODELS / spec.turbulence
    if of_model.is_dir():
        shutil.copytree(of_model, folder, dirs_exist_ok=True)
    lacking = [field.name for field in spec.model.fields if not (folder / "0" / field.name).exists()]
    if lacking:
        raise FoamError(f"the case template has no 0/{lacking[0]} for {spec.turbulence}: put it into {of_model / '0'}")
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


def read_parameters(folder: Path) -> dict[str, str]:
    """``system/parameters`` of a case by name; empty for a case that was not written from the template."""
    path = folder / PARAMETERS
    return dict(re.findall(r"^(\w+)\s+([^;]*);", path.read_text(), re.M)) if path.exists() else {}


def write_inlets(spec: FlowSpec, folder: Path) -> None:
    """Write ``system/inlets``, what enters where; a parabolic profile once the case has its mesh.

    Each face of the inlet gets the profile's mean over it, so that the flow rate is exact on every mesh:
    u = 3/2 U (1 - (2 x / W)^2), laminar flow between plates.
    """
    velocity = f"uniform (0 {spec.along * spec.speed:.12g} 0)"
    if spec.profile == "parabolic" and (folder / "constant" / "polyMesh" / "boundary").exists():
        speeds = spec.along * _parabola(spec, folder)
        velocity = f"nonuniform List<vector> {len(speeds)}(" + " ".join(f"(0 {y:.12g} 0)" for y in speeds) + ")"
    rows: dict[str, dict[str, str]] = {"U": {"inlet": velocity}, **{field.name: {} for field in spec.transported}}
    for stream in spec.inlets:
        inward = stream.velocity if stream.side == "left" else -stream.velocity
        patch = f"inlet_{stream.name}"
        rows["U"][patch] = f"uniform ({inward:.12g} 0 0)"
        for field, value in spec.entering(stream.velocity, stream.width).items():
            rows[field.name][patch] = f"uniform {value:.12g}"
    known = turbulence_models[USUAL].transported  # system/parameters holds theirs
    further = {f: v for f, v in spec.entering(spec.speed, spec.mesh.width).items() if f not in known}
    path = folder / INLETS
    head = path.read_text().split("\ninletsU", 1)[0]
    with atomic_write(path) as out:
        out.write(head)
        for name, patches in rows.items():
            entries = "".join(f"    {patch} {{ type fixedValue; value {v}; }}\n" for patch, v in patches.items())
            out.write(f"\ninlets{name[0].upper()}{name[1:]}\n{{\n{entries}}}\n")
        for field, value in further.items():
            out.write(f"\n{field.inlet} {value:.12g};\n")


def _parabola(spec: FlowSpec, folder: Path) -> NDArray[np.float64]:
    """Mean speed (m/s) over every face of the patch ``inlet``, in the patch's order."""
    plane = read_polymesh(folder).plane
    x = 2.0 * plane.points[plane.faces[plane.on("inlet")], 0] / spec.mesh.width
    a, b = x.T
    return np.asarray(1.5 * spec.speed * (1.0 - (a * a + a * b + b * b) / 3.0))  # mean of x^2 over [a, b]


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
