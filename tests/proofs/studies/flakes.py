"""Rigid plates and kernels thrown on a slope, and what the models ``flake`` and ``kernel`` make of them.

flakes: Plates of random orientation fall on a slope and are followed through all their blows, each at the lowest corner
with restitution and Coulomb friction, until they are clear of it or lie on it. Printed are the spin about the axis
across the picture beside that of a disc with the equal ball's radius, the velocity of the centre along and off the
slope, TURN and SPREAD of laws/flake.py as these plates give them, and the time in which still air halves the rms spin
of one of 0.19 kg/m2. docs/model.md: flakes --count 1500

flakes_in_air: The same plates in a stream of 3.5 m/s for 60 ms, by the quasi-steady pressure on strips, without the
circulation of their rotation: how far they come across the stream, and how far the law of laws/flake.py takes those of
the same spins. docs/model.md: flakes_in_air --count 1000

chaff_alone: Where chaff of the shipped rhombus lands alone in its steady air. docs/model.md

kernels: Ellipsoids of measured kernels' dimensions on a slope, as the plates: the restitution that a drop test on a
level plate would find of them, what they keep of their way along the slope (as m r^2 / I of a granule that rolls), off
it, and how they scatter: as the rms angle of the model ``kernel`` that scatters their velocities, and where they land
four body widths below, as much. docs/model.md
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from support import shipped
from wakeflow.laws.collision import collide, impact_models, scattered_rebound
from wakeflow.laws.flake import BROADSIDE, plate_lift, plate_torque, shape_of

from .common import ALONE, Row, piped, separation, show, with_one_fraction

Array = NDArray[np.float64]
G = 9.81
STEP = 5e-5  # s: a corner at 3 m/s goes 0.15 mm
LONGEST = 0.06  # s
LYING = 60  # blows: one that has had so many lies on the slope and slides
CORNERS = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


def _turned(axes: Array, by: Array) -> Array:
    """Axes (n, 3, 3), columns, turned by the vectors ``by`` (n, 3) rad (Rodrigues)."""
    angle = np.linalg.norm(by, axis=1)[:, None]
    k = by / np.maximum(angle, 1e-300)
    c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
    along = np.einsum("ni,nij->nj", k, axes)[:, None, :] * k[:, :, None]
    return axes * c + np.cross(k[:, :, None], axes, axis=1) * s + along * (1.0 - c)


class Plates:
    """n plates of ``sides`` (3,) m, whose centres come with ``velocity`` (3,) m/s to a wall z = 0 that x descends;
    ``pull`` (3,) m/s2.
    """

    def __init__(self, sides: Array, count: int, velocity: Array, pull: Array, rng: np.random.Generator) -> None:
        q = rng.standard_normal((count, 3, 3))
        self.axes, r = np.linalg.qr(q)
        self.axes *= np.sign(np.einsum("nii->ni", r))[:, None, :]
        self.axes[np.linalg.det(self.axes) < 0.0] *= -1.0
        self.corners = CORNERS * sides
        self.moments = (np.sum(sides**2) - sides**2) / 12.0  # per mass
        self.velocity, self.pull = np.tile(velocity, (count, 1)), pull
        self.spin = np.zeros((count, 3))
        self.blows = np.zeros(count, dtype=int)
        self.high = -self._arms()[..., 2].min(axis=1)  # of the centre, when the lowest corner touches

    def _arms(self) -> Array:
        """From the centre to the corners (n, 8, 3)."""
        return np.einsum("nij,kj->nki", self.axes, self.corners)

    def _inverse_inertia(self, some: Any) -> Array:
        axes = self.axes[some]
        return np.einsum("nij,j,nkj->nik", axes, 1.0 / self.moments, axes)

    def fly(self, step: float) -> None:
        """A step of free flight: a torque-free body keeps its angular momentum."""
        momentum = np.einsum("nij,j,nkj,nk->ni", self.axes, self.moments, self.axes, self.spin)
        half = _turned(self.axes, 0.5 * step * self.spin)
        middle = np.einsum("nij,j,nkj,nk->ni", half, 1.0 / self.moments, half, momentum)
        self.axes = _turned(self.axes, step * middle)
        self.spin = np.einsum("nij,j,nkj,nk->ni", self.axes, 1.0 / self.moments, self.axes, momentum)
        self.high = self.high + step * self.velocity[:, 2] + 0.5 * step**2 * self.pull[2]
        self.velocity = self.velocity + step * self.pull

    def strike(self, restitution: float, friction: float) -> None:
        """One blow at the lowest corner of those that reach into the wall and approach it there."""
        arms = self._arms()
        speed = self.velocity[:, None] + np.cross(self.spin[:, None], arms)
        below = (self.high[:, None] + arms[..., 2] < 0.0) & (speed[..., 2] < 0.0)
        worst = np.where(below, speed[..., 2], 0.0).argmin(axis=1)
        some = np.flatnonzero(below.any(axis=1))
        if not len(some):
            return
        arm, slip = arms[some, worst[some]], speed[some, worst[some]]
        impulse = self._impulse(some, arm, slip, restitution, friction)
        self.velocity[some] += impulse
        self.spin[some] += np.einsum("nij,nj->ni", self._inverse_inertia(some), np.cross(arm, impulse))
        self.blows[some] += 1

    def _impulse(self, some: Any, arm: Array, slip: Array, restitution: float, friction: float) -> Array:
        """Per mass: it sticks if friction can stop the corner, else friction opposes its slip (Routh 1897)."""
        k = np.zeros((len(some), 3, 3))
        k[:, 0, 1], k[:, 0, 2], k[:, 1, 2] = -arm[:, 2], arm[:, 1], -arm[:, 0]
        k -= k.transpose(0, 2, 1)
        give = np.eye(3) - k @ self._inverse_inertia(some) @ k
        wanted = -slip * (1.0, 1.0, 1.0 + restitution)
        stuck = np.linalg.solve(give, wanted[..., None])[..., 0]
        sideways = np.hypot(slip[:, 0], slip[:, 1])[:, None]
        slides = np.concatenate(
            [-friction * slip[:, :2] / np.maximum(sideways, 1e-12), np.ones((len(some), 1))], axis=1
        )
        sliding = slides * (wanted[:, 2] / np.einsum("ni,ni->n", give[:, 2], slides))[:, None]
        holds = (np.hypot(stuck[:, 0], stuck[:, 1]) <= friction * stuck[:, 2])[:, None]
        # a sliding corner that jams would gain energy: it sticks
        return np.where(holds | (sliding[:, 2:] <= 0.0), stuck, sliding)

    @property
    def clear(self) -> NDArray[np.bool_]:
        """Those that nothing brings back soon: they rise, and no corner reaches the wall however they turn."""
        reach = 0.5 * float(np.linalg.norm(self.corners[0] * 2.0))
        return (self.high > reach) & (self.velocity[:, 2] > 0.0)


def thrown(
    sides: Array, speed: float, slope: float, restitution: float, friction: float, count: int, seed: int = 1,
    kind: Callable[..., Plates] = Plates,
) -> tuple[Plates, NDArray[np.bool_]]:  # fmt: skip
    """Plates, or another ``kind``, after their blows on a ``slope`` (rad), on which they fell at ``speed`` (m/s); which
    of them lie on it.
    """
    down = np.array([math.sin(slope), 0.0, -math.cos(slope)])
    plates = kind(sides, count, speed * down, G * down, np.random.default_rng(seed))
    velocity, spin = plates.velocity.copy(), plates.spin.copy()
    clear = lies = np.zeros(count, dtype=bool)
    for _ in range(round(LONGEST / STEP)):
        plates.strike(restitution, friction)
        new = plates.clear & ~clear
        velocity[new], spin[new] = plates.velocity[new], plates.spin[new]
        clear |= new
        lies = ~clear & (plates.blows >= LYING)
        if (clear | lies).all():
            break
        plates.fly(STEP)
    velocity[~clear] = plates.velocity[~clear]
    spin[~clear] = np.where(lies[~clear][:, None], 0.0, plates.spin[~clear])
    plates.velocity, plates.spin = velocity, spin
    return plates, lies


COLUMNS = {
    "plate, mm": "{plate}", "slope, deg": "{slope:g}", "R": "{restitution:g}", "f": "{friction:g}",
    "of one sense, %": "{same:.0f}", "mean, 1/s": "{mean:.0f}", "rms": "{rms:.0f}", "a disc's": "{disc:.0f}",
    "blows": "{blows:.1f}", "lie, %": "{lies:.0f}", "along, m/s": "{along:.2f} ± {along_std:.2f}",
    "a disc's, m/s": "{disc_along:.2f}", "off, m/s": "{off:.2f} ± {off_std:.2f}", "a disc's, off": "{disc_off:.2f}",
    "TURN": "{turn:.2f}", "SPREAD": "{spread:.2f}", "halved in, ms": "{halved:.0f}",
}  # fmt: skip
PLATES = ((6.0, 2.0, 0.2), (3.0, 3.0, 0.1), (10.0, 3.0, 0.2), (12.65, 3.69, 3.69))  # mm
SLOPES = ((45.0, 0.2, 0.4), (45.0, 0.5, 0.3), (60.0, 0.2, 0.4), (30.0, 0.2, 0.4))  # deg, restitution, friction
SPEED = 2.42  # m/s, of chaff that comes to the shipped rhombus
AREAL, AIR = 0.19, 1.2  # kg/m2 of a glume, kg/m3


def row_of(plate: tuple[float, ...], slope: float, restitution: float, friction: float, count: int) -> Row:
    """What becomes of ``count`` plates beside a disc with the equal ball's radius."""
    sides, beta = 1e-3 * np.array(plate), math.radians(slope)
    plates, lies = thrown(sides, SPEED, beta, restitution, friction, count)
    radius = 0.5 * sides[0] / shape_of(sides.tolist(), flake=True)[0]
    disc = collide(
        SPEED * math.sin(beta), -SPEED * math.cos(beta), 0.0, 0.0, 1.0, 0.0, 0.0, restitution, friction, 2.0, radius
    )
    spin, scale = plates.spin[:, 1], math.sqrt(sides[0] * sides[1])
    mean, rms = float(spin.mean()), float(np.sqrt((spin**2).mean()))
    torque = float(plate_torque(sides[None], np.array([AIR * sides[2] / AREAL]))[0])
    return {
        "plate": " x ".join(f"{side:g}" for side in plate), "slope": slope, "restitution": restitution,
        "friction": friction, "same": 100.0 * float((spin > 0.0).sum() / (spin != 0.0).sum()), "mean": mean, "rms": rms,
        "disc": abs(disc[2]), "blows": float(plates.blows[~lies].mean()), "lies": 100.0 * float(lies.mean()),
        "along": plates.velocity[:, 0].mean(), "along_std": plates.velocity[:, 0].std(), "disc_along": disc[0],
        "off": plates.velocity[:, 2].mean(), "off_std": plates.velocity[:, 2].std(), "disc_off": disc[1],
        "turn": mean * scale / abs(disc[4]), "spread": float(spin.std()) * scale / disc[3],
        "halved": 1e3 / (torque * rms),
    }  # fmt: skip


def flakes(count: int = 2000) -> list[Row]:
    """Plates thrown on slopes."""

    def rows() -> Iterator[Row]:
        for plate in PLATES:
            for slope in SLOPES:
                yield row_of(plate, *slope, count)

    return show(COLUMNS, rows())


# -- plates in a stream ------------------------------------------------------------------------------------------------
STREAM, FLIGHT, PUFF = 3.5, 0.06, 1e-4  # m/s, s, s: slip and time of flight off the shipped rhombus; a step
STRIPS = np.array([((i + 0.5) / 8 - 0.5, (j + 0.5) / 4 - 0.5, 0.0) for i in range(8) for j in range(4)])
AIR_COLUMNS = {
    "plate, mm": "{plate}", "R": "{restitution:g}", "f": "{friction:g}", "across the stream, rms, mm": "{lateral:.1f}",
    "by the law, rms, mm": "{law:.1f}", "spin, rms, 1/s": "{before:.0f}", "after": "{after:.0f}",
    "correlation": "{kept:.2f}",
}  # fmt: skip


def _pressed(plates: Plates, sides: Array) -> tuple[Array, Array]:
    """Force and torque per mass (n, 3) of a stream along x on plates of AREAL: C_N = 2 pi sin a / (4 + pi sin a) (Lord
    Rayleigh 1876, made 1.2 broadside) on strips by their own velocities, 3/4 cos a / (4 + pi sin a) chords off the
    middle.
    """
    normal, wind = plates.axes[:, :, 2], np.array([STREAM, 0.0, 0.0]) - plates.velocity
    arms = np.einsum("nij,kj->nki", plates.axes, STRIPS * sides)
    air = wind[:, None] - np.cross(plates.spin[:, None], arms)
    into = np.einsum("ni,ni->n", wind, normal)
    sine = np.abs(into) / np.linalg.norm(wind, axis=1)
    steep = 0.5 * AIR * BROADSIDE * (4.0 + math.pi) / (4.0 + math.pi * sine) / (AREAL * len(STRIPS))
    part = steep[:, None] * np.linalg.norm(air, axis=2) * np.einsum("nki,ni->nk", air, normal)
    force = part.sum(axis=1)[:, None] * normal
    along = into[:, None] * normal - wind
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    chord = 1.0 / np.max(
        [np.abs(np.einsum("ni,ni->n", along, plates.axes[:, :, k])) / sides[k] for k in (0, 1)], axis=0
    )
    ahead = 0.75 * np.sqrt(1.0 - sine**2) / (4.0 + math.pi * sine) * chord
    return force, np.cross(arms, part[..., None] * normal[:, None]).sum(axis=1) + np.cross(
        ahead[:, None] * along, force
    )


def flight_row(plate: tuple[float, ...], restitution: float, friction: float, count: int) -> Row:
    """Plates that leave a slope of 45 degrees in a stream, beside the law for the spins that they leave with."""
    sides = 1e-3 * np.array(plate)
    plates, lies = thrown(sides, SPEED, math.radians(45.0), restitution, friction, count)
    plates.axes, plates.spin = plates.axes[~lies], plates.spin[~lies]
    before, place = plates.spin[:, 1], np.zeros_like(plates.spin)
    plates.velocity, plates.pull = np.zeros_like(plates.spin), np.zeros(3)
    plates.high = np.zeros(len(before))
    for _ in range(round(FLIGHT / PUFF)):
        force, torque = _pressed(plates, sides)
        plates.fly(PUFF)
        plates.velocity = plates.velocity + PUFF * force
        place += PUFF * plates.velocity
        plates.spin = plates.spin + PUFF * np.einsum("nij,nj->ni", plates._inverse_inertia(slice(None)), torque)
    ratio = np.array([AIR * sides[2] / AREAL])
    lift, stop = plate_lift(sides[None], ratio)[0], plate_torque(sides[None], ratio)[0]
    times = np.linspace(0.0, FLIGHT, 200)
    spun = before / (1.0 + stop * np.abs(before) * times[:, None])
    law = np.sum(lift * STREAM * spun * (FLIGHT - times)[:, None], axis=0) * times[1]
    return {
        "plate": " x ".join(f"{side:g}" for side in plate), "restitution": restitution, "friction": friction,
        "lateral": 1e3 * place[:, 2].std(), "law": 1e3 * law.std(), "before": before.std(),
        "after": plates.spin[:, 1].std(), "kept": np.corrcoef(before, plates.spin[:, 1])[0, 1],
    }  # fmt: skip


def flakes_in_air(count: int = 2000) -> list[Row]:
    """Plates that left a slope, FLIGHT later in a stream."""
    blows = ((0.2, 0.4), (0.5, 0.3))
    return show(AIR_COLUMNS, (flight_row(plate, *blow, count) for plate in PLATES[:3] for blow in blows))


# -- chaff of the shipped rhombus --------------------------------------------------------------------------------------
WAYS: dict[str, tuple[dict[str, str], dict[str, bool]]] = {
    "flake": ({}, {}),
    "flake, with the drag of a scaled sphere": ({"fraction.chaff.drag": "brown-lawler"}, {}),
    "disc": ({"fraction.chaff.impact": "disc"}, {}),
    "flake, no spin lift": ({}, {"magnus": False}),
}
PLACES = {"middle": ("middle",), "inner": ("inner-left", "inner-right"), "outer": ("outer-left", "outer-right")}


def chaff_alone(*, count: int = 4096, mesh_scale: float = 1.0) -> list[Row]:
    """Chaff of the shipped rhombus alone in its steady air, which does not feel it: shares in percent."""

    def rows() -> Iterator[Row]:
        for way, (changes, force) in WAYS.items():
            whole = shipped("rhombus", {"feed.count": count, "numerics.mesh_scale": mesh_scale, **changes})
            scene = with_one_fraction(whole, "chaff", rate=None, depth=None)
            found = separation(piped(scene, "draft", {**ALONE, **force})).fractions["chaff"]
            row: Row = {"chaff as": way}
            for place, bins in PLACES.items():
                parts = [found[one] for one in bins]
                half = sum(part.half**2 for part in parts) ** 0.5
                row[place] = f"{100 * sum(part.value for part in parts):.1f} ± {100 * half:.1f}"
            yield row

    return show(("chaff as", *PLACES), rows())


# -- kernels -----------------------------------------------------------------------------------------------------------
GRAINS = {"wheat": (7.08, 3.27, 2.98), "wheat, Sakha 93": (6.18, 2.80, 2.21), "barley": (9.85, 3.52, 2.49)}  # mm
FALL, BELOW = 1.6, 0.215  # m/s, of wheat that comes to the shipped rhombus; m, from there to its floor
USUAL = (45.0, 0.57, 0.29)  # deg, restitution of the surface, friction: 0.5 in a drop test
BLOWS = (USUAL, (45.0, 0.46, 0.29), (45.0, 0.68, 0.29), (45.0, 0.57, 0.25), (45.0, 0.57, 0.34), (35.0, 0.57, 0.29),
         (55.0, 0.57, 0.29))  # fmt: skip
XI = np.random.default_rng(5).standard_normal(20_000)
KERNEL_COLUMNS = {
    "kernel": "{kernel}", "comes": "{comes}", "slope, deg": "{slope:g}", "R": "{restitution:g}", "f": "{friction:g}",
    "drop test": "{drop:.2f}", "m r² / I": "{turns:.2f}", "off over drop test": "{off:.2f}",
    "scatter by velocity": "{by_velocity:.2f}", "by landing": "{by_landing:.2f}",
    "lands, mm: 5, 25, 50, 75, 95 %": "{lands}", "as the model has it": "{modelled}",
}  # fmt: skip


class Kernels(Plates):
    """Ellipsoids, which touch a wall at one point; ``level``: with the long axis level, as on a slope of so many rad,
    else turned by chance.
    """

    def __init__(
        self, sides: Array, count: int, velocity: Array, pull: Array, rng: np.random.Generator,
        level: float | None = None,
    ) -> None:  # fmt: skip
        self.half = 0.5 * sides
        super().__init__(sides, count, velocity, pull, rng)
        self.moments = (np.sum(sides**2) - sides**2) / 20.0
        if level is not None:
            turn = rng.uniform(0.0, 2.0 * math.pi, count)[:, None]
            ahead, aside = np.array([math.cos(level), 0.0, math.sin(level)]), np.array([0.0, 1.0, 0.0])
            long = np.cos(turn) * ahead + np.sin(turn) * aside
            across = np.cross(long, rng.standard_normal((count, 3)))
            across /= np.linalg.norm(across, axis=1)[:, None]
            self.axes = np.stack([long, across, np.cross(long, across)], axis=2)
            self.high = -self._arms()[..., 2].min(axis=1)

    def _arms(self) -> Array:
        """From the centre to the lowest point of the surface (n, 1, 3)."""
        down = -self.axes[:, 2, :]
        lowest = down * self.half**2 / np.linalg.norm(down * self.half, axis=1)[:, None]
        return np.einsum("nij,nj->ni", self.axes, lowest)[:, None]


def landing(along: Array, off: Array, slope: float) -> Array:
    """How far aside (mm) a granule lands in a vacuum BELOW the ``slope`` that it leaves with these velocities (m/s)."""
    aside = along * math.cos(slope) + off * math.sin(slope)
    up = off * math.cos(slope) - along * math.sin(slope)
    return np.asarray(1e3 * aside * (up + np.sqrt(up**2 + 2.0 * G * BELOW)) / G)


def modelled(scatter: float, restitution: float, friction: float, slope: float) -> tuple[Array, Array]:
    """Velocities (m/s) along and off the slope of granules of the model ``kernel`` with an rms ``scatter`` (rad)."""
    n = len(XI)
    came, up = np.tile([FALL * math.sin(slope), -FALL * math.cos(slope)], (n, 1)), np.tile([0.0, 1.0], (n, 1))
    mobility = 1.0 / impact_models["kernel"].inertia
    left, _, _ = scattered_rebound(
        came, np.zeros(n), up, np.zeros((n, 2)), np.full(n, restitution), np.full(n, friction), mobility,
        np.full(n, 1e-3), 0.0, scatter * XI,
    )  # fmt: skip
    return left[:, 0], left[:, 1]


def scatter_of(wanted: float, measure: Callable[[Array, Array], float], *law: float) -> float:
    """The scatter (rad) with which the model has the ``wanted`` measure; nan beyond 0.02 to 0.4."""

    def short(scatter: float) -> float:
        return measure(*modelled(scatter, *law)) - wanted

    return float(brentq(short, 0.02, 0.4)) if short(0.02) < 0.0 < short(0.4) else math.nan


def kernel_row(grain: str, blow: tuple[float, float, float], count: int, *, level: bool) -> Row:
    """``count`` kernels beside the model."""
    sides, (degrees, restitution, friction) = 1e-3 * np.array(GRAINS[grain]), blow
    slope = math.radians(degrees)
    surface = restitution, friction, count
    dropped, _ = thrown(sides, FALL, 0.0, *surface, kind=Kernels)
    kernels, _ = thrown(sides, FALL, slope, *surface, kind=partial(Kernels, level=slope if level else None))
    drop, (along, off) = float(dropped.velocity[:, 2].mean()) / FALL, kernels.velocity[:, (0, 2)].T
    law, parts = (drop, friction, slope), [0.05, 0.25, 0.5, 0.75, 0.95]

    def spread(along: Array, off: Array) -> float:
        return math.hypot(along.std(), off.std())

    def short_of_the_middle(along: Array, off: Array) -> float:
        tenth, middle = np.quantile(landing(along, off, slope), (0.1, 0.5))
        return float(middle - tenth)

    def lands(along: Array, off: Array) -> str:
        return " ".join(f"{x:.0f}" for x in np.quantile(landing(along, off, slope), parts))

    return {
        "kernel": grain, "comes": "level" if level else "any way", "slope": degrees, "restitution": restitution,
        "friction": friction, "drop": drop, "turns": 1.0 / (1.0 - along.mean() / (FALL * math.sin(slope))) - 1.0,
        "off": off.mean() / (FALL * math.cos(slope)) / drop,
        "by_velocity": scatter_of(spread(along, off), spread, *law),
        "by_landing": scatter_of(short_of_the_middle(along, off), short_of_the_middle, *law),
        "lands": lands(along, off), "modelled": lands(*modelled(0.15, *law)),
    }  # fmt: skip


def kernels(count: int = 4000) -> list[Row]:
    """Kernels thrown on slopes, beside the model."""

    def rows() -> Iterator[Row]:
        for grain in GRAINS:
            for blow in BLOWS:
                yield kernel_row(grain, blow, count, level=False)
            yield kernel_row(grain, USUAL, count, level=True)

    return show(KERNEL_COLUMNS, rows())
