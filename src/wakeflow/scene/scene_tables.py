"""[numerics], [limit], [price], and all tables of a scene together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from ..core.errors import SceneError, known
from ..core.geometry import are_symmetric
from ..core.registry import did_you_mean
from ..laws.constants import GRAVITY
from .bins import AnyBin, SideBin
from .fan_speed import fan_point
from .feed import CollisionTable, Feed, Funnel
from .fraction import Fraction
from .machine import Air, Body, Channel, Plumb, Vibration
from .measured import Tray
from .pictures import AnyPicture
from .rungs import rungs
from .table import (
    RESERVED_BIN,
    UNSET,
    AirFlow,
    Array,
    Drop,
    Gravity,
    Name,
    Portion,
    Shorthand,
    Table,
    WithUnit,
    flat,
    rise,
)
from .uncertainty import UncertaintyTable, margins

# -- [limit] and [price]: what the answer is held to, and what it is worth ---------------------------------------------
TARGET = "target"  # of a price: all bins where the fraction should land
Price = Annotated[float, Field(ge=-1e7, le=1e7), WithUnit("EUR/t", "220 EUR/t")]
PowerPrice = Annotated[float, Field(ge=0, le=100), WithUnit("EUR/kWh", "0.25 EUR/kWh")]


class FanEfficiency(Table):
    """What part of the electricity a fan, its drive and its motor turn into pressure and flow, over the flow."""

    flow: list[AirFlow] = Field(description="rising")
    efficiency: list[Annotated[float, Field(gt=0, le=1), WithUnit("1", "55 %")]] = Field(
        description="efficiency at each flow"
    )

    @model_validator(mode="after")
    def _paired(self) -> FanEfficiency:
        if not self.flow or len(self.flow) != len(self.efficiency) or not rise(self.flow):
            raise SceneError("needs as many efficiencies as flows, and flows that rise")
        return self

    def at(self, flow: float) -> float:
        """Efficiency at a flow (m3/s); beyond the ends that of the end."""
        return float(np.interp(flow, self.flow, self.efficiency))


class LimitTable(Table):
    """[limit]: what the answer is held to, loss.FRACTION = "0.5 %" or dirt.BIN = "2 %": met, not met or open."""

    loss: dict[Name, Portion] = Field({}, description="share of a fraction outside its targets, at most, by fraction")
    dirt: dict[Name, Portion] = Field(
        {}, description="share of a bin's mass that is of fractions whose target it is not, at most, by bin"
    )

    @property
    def by_name(self) -> dict[str, float]:
        """The limits by the names of what they limit: loss.FRACTION and dirt.BIN."""
        return {f"loss.{name}": most for name, most in self.loss.items()} | {
            f"dirt.{place}": most for place, most in self.dirt.items()
        }

    def mistakes(self, wanted: list[str], products: list[str]) -> Iterator[str]:
        """What is limited that no answer has: the loss of what is not among the fractions ``wanted`` in a bin, the dirt
        of what is no product.
        """
        for kind, given, names, lacks in (
            ("loss", self.loss, wanted, "no fraction with a target"),
            ("dirt", self.dirt, products, "no bin that is a fraction's target"),
        ):
            for name in given:
                if name not in names:
                    named = f"known: {', '.join(names)}" if names else "give fraction.NAME.target, a bin"
                    yield f"limit.{kind}.{name}: {lacks}{did_you_mean(name, names)} ({named})"


class PriceTable(Table):
    """[price]: what a tonne of each fraction is worth where it lands, and what the fan's electricity costs."""

    value: dict[Name, Annotated[dict[Name, Price], Shorthand(str | float, lambda price: {TARGET: price})]] = Field(
        {},
        description="EUR/t of a fraction in its targets, or by bin, { target = 220, middle = 90 }; nothing elsewhere",
    )
    electricity: PowerPrice | None = Field(None, description="price of the fan's electricity")
    fan_efficiency: (
        Annotated[FanEfficiency, Shorthand(str | float, lambda share: {"flow": [0.0], "efficiency": [share]})] | None
    ) = Field(
        None,
        description="efficiency of fan, drive and motor together, or a curve: { flow = [...], efficiency = [...] }",
    )
    other_drop: Drop = Field(0.0, description="pressure that the fan gives beside the channel: ducts, filter, cyclone")

    @property
    def given(self) -> bool:
        """Whether anything has a price."""
        return bool(self.value) or self.electricity is not None

    def by_bin(self, targets: Mapping[str, tuple[str, ...]]) -> dict[str, dict[str, float]]:
        """EUR/t of each fraction by bin, of fractions with these ``targets``; a bin's own price goes first."""
        return {
            name: {place: row[TARGET] for place in targets[name] if TARGET in row}
            | {place: price for place, price in row.items() if place != TARGET}
            for name, row in self.value.items()
        }

    def fan_power(self, drop: float | None, flow: float | None, depth: float) -> float | None:
        """W of a fan that gives the pressure ``drop`` (Pa) of a channel of this ``depth`` (m), and the other drop, to
        its air, whose ``flow`` (m2/s) is by depth; None where drop or flow is not known.
        """
        if drop is None or flow is None or self.fan_efficiency is None:
            return None
        return max(0.0, drop + self.other_drop) * flow * depth / self.fan_efficiency.at(flow * depth)

    def mistakes(self, targets: Mapping[str, tuple[str, ...]], bins: list[str]) -> Iterator[str]:
        """What is priced that there is not, among fractions with these ``targets`` and ``bins``."""
        for name, row in self.value.items():
            if name not in targets:
                hint = did_you_mean(name, list(targets))
                yield f"price.value.{name}: no fraction{hint} (known: {', '.join(targets)})"
                continue
            for place in row:
                places = [*bins, RESERVED_BIN, TARGET]
                if place not in places:
                    hint = did_you_mean(place, places)
                    yield f"price.value.{name}.{place}: no bin{hint} (known: {', '.join(places)})"
            if TARGET in row and not targets[name]:
                yield f"price.value.{name}: it has no target; give fraction.{name}.target, or a price by bin"
        if (self.electricity is None) != (self.fan_efficiency is None):
            lacking = "electricity" if self.electricity is None else "fan_efficiency"
            yield f"price.{lacking}: missing; the fan's cost takes electricity and fan_efficiency"


# -- Terms that are switched by hand -----------------------------------------------------------------------------------
States = Mapping[str, bool | str | Mapping[str, bool | str]]  # of terms: True or "on", False or "off"
ON_OFF = "on", "off"


def switched(force: States | None) -> dict[str, bool]:
    """Terms that are switched from Python, each True, False, "on" or "off"; empty without any.

    Raises SceneError for anything else: another text would count as true.
    """
    if force is None:
        return {}
    if not isinstance(force, Mapping):
        raise SceneError(f"force = {force!r}: name each term and its state, {{'lift': 'off'}}")
    try:
        return states_of(force)
    except ValueError as problem:
        raise SceneError(f"force: {problem}") from None


def states_of(table: States) -> dict[str, bool]:
    """{"chaff.lift": True} from {chaff: {lift: "on"}}, as TOML reads ``chaff.lift = "on"``. Raises ValueError for a
    state that is none.
    """
    states = {str(key): state for key, state in flat(table).items() if state != {}}
    for key, state in states.items():
        if not isinstance(state, bool) and state not in ON_OFF:
            raise ValueError(f"{key} = {state!r}: write on or off")
    return {key: state in (True, "on") for key, state in states.items()}


# -- [numerics] --------------------------------------------------------------------------------------------------------
Switches = dict[str, bool | Literal["on", "off"] | dict[str, bool | Literal["on", "off"]]]
MAX_RANKS = 256  # beyond what any mesh of one layer can use

if TYPE_CHECKING:
    RungName = str
else:
    RungName = Literal[tuple(rungs)]


def _ranks(value: object) -> object:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= MAX_RANKS):
        return value
    raise ValueError(f"give auto, or a whole number of processes from 1 to {MAX_RANKS}")


class SpanTable(Table):
    """[numerics.span]: what rung 3d computes of the third dimension."""

    depth: Annotated[float, Field(ge=0.5, le=20.0)] = Field(2.5, description="depth of periodic span, in body widths")
    layers: Annotated[int, Field(ge=4, le=512), UNSET] = Field(
        0, description="layers of cells over the span; 8 a body width by default"
    )
    shedding_cycles: Annotated[float, Field(ge=0.5, le=1000.0)] = Field(
        30.0, description="recorded: of six body widths of travel each, the usual length of a cycle"
    )


class Numerics(Table):
    """[numerics]: how it is computed."""

    rung: RungName = Field("auto", description="fidelity of the airflow")
    tolerance: Annotated[float, Field(gt=0, le=0.1)] = Field(
        1e-2, description="landing error in body widths; channel widths without a body"
    )
    target_error: Annotated[float, Field(gt=0, le=0.5), WithUnit("1", "1 %")] = Field(
        0.01, description="error of a bin's share that is asked for: terms that could not move so much are left out"
    )
    mesh_scale: Annotated[float, Field(ge=0.2, le=4.0)] = Field(1.0, description="factor on every cell edge")
    averaging: Annotated[float, Field(ge=0.001, le=0.5), WithUnit("1", "1 %"), UNSET] = Field(
        0.0, description="relative half width of drag's and base pressure's averages at which a shedding airflow ends"
    )
    ranks: Annotated[Literal["auto"] | int, BeforeValidator(_ranks)] = Field(
        "auto", description="MPI processes of an airflow, 1 to 256; auto: by its cells alone, two from 60 000 on"
    )
    loading_passes: Annotated[int, Field(ge=1, le=10)] = Field(
        3, description="solutions under the granules' force on the air, at most; 1: once, its whole effect its error"
    )
    keep: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        2000, description="granules kept in granules.npz per fraction"
    )
    snapshots: Annotated[int, Field(ge=0, le=1000)] = Field(
        32, description="moments of a changing airflow in field.pvd; 0: its mean alone"
    )
    span: SpanTable = Field(SpanTable(), description="third dimension of rung 3d")


class ReportTable(Table):
    """[report]: what stands on the report's first page beside the answer."""

    title: Annotated[str, Field(min_length=1, max_length=200), UNSET] = Field("", description="default: the folder")
    note: Annotated[str, Field(max_length=2000), UNSET] = Field("", description="a few words of yours below it")
    logo: Annotated[str, UNSET] = Field("", description="a PNG, SVG or JPEG file, relative to the scene file")


def _switches(value: object) -> object:
    return states_of(value) if isinstance(value, Mapping) else value


LENGTH_ROUNDING = 1e-9  # m, and of a unit vector: what is so near is the same


def _same_line(first: Array, second: Array) -> bool:
    """Whether two lines (k, 2) of points are one, from either end, or closed ones with the same corners."""
    if len(first) == len(second) > 3 and all(np.array_equal(line[0], line[-1]) for line in (first, second)):
        gaps = np.abs(first[:, None] - second).max(axis=2)
        return bool(max(gaps.min(axis=0).max(), gaps.min(axis=1).max()) <= LENGTH_ROUNDING)
    return first.shape == second.shape and any(
        np.allclose(first, way, rtol=0.0, atol=LENGTH_ROUNDING) for way in (second, second[::-1])
    )


class SceneTables(Table):
    """All tables of a scene, and what follows from them."""

    materials: Annotated[str, UNSET] = Field(
        "", description="file of materials of your own, relative to the scene file: its values are read in"
    )
    body: dict[Name, Body] = Field({}, description="without one the air is known, and nothing is solved")
    channel: Channel
    gravity: Gravity = Field(GRAVITY, description="gravity of a centrifuge or a planet; its direction is channel.tilt")
    air: Air | None = None
    vibration: Vibration | None = None
    feed: Feed
    funnel: Funnel | None = None
    fraction: Annotated[dict[Name, Fraction], Field(min_length=1)]
    bin: Annotated[dict[Name, AnyBin], Field(min_length=1)]
    collisions: CollisionTable = CollisionTable()
    force: Annotated[dict[str, bool], BeforeValidator(_switches, json_schema_input_type=Switches)] = Field(
        {}, description="terms switched by hand, on or off: TERM for all fractions, FRACTION.TERM for one"
    )
    uncertainty: Annotated[UncertaintyTable, BeforeValidator(margins)] = Field(
        {}, description="half of the 95 % interval of a number, by its key: uncertainty.air.speed = '3 %'; 0: exact"
    )
    limit: LimitTable = LimitTable()
    price: PriceTable = PriceTable()
    picture: dict[Name, AnyPicture] = Field({}, description="drawn beside the usual pictures")
    report: ReportTable = ReportTable()
    measured: list[Tray] = Field(
        [], description="what lay in the trays of the real machine, or the CSV file that says it; set beside the answer"
    )
    numerics: Numerics = Numerics()

    @model_validator(mode="after")
    def _weigh(self) -> Self:
        for table in (self.feed, self.vibration, self.funnel):
            if table is not None:
                table.weighed(self.gravity)
        if self.vibration is not None:
            self.vibration.take_arms(self.body)
        if self.air is not None and self.air.fan is not None:
            self.air.blown(fan_point(self, self.air.fan))
        return self

    @property
    def airstream(self) -> Air:
        """The air of a scene that has some. Raises LookupError in a vacuum."""
        return known(self.air, "the air of a vacuum")

    @property
    def width(self) -> float:
        """Width of the first body (m), of the channel where there is no body: the unit of every reported error."""
        return float(np.ptp(self.outline[:, 0])) if self.body else self.channel.width

    @property
    def unit(self) -> str:
        """What :attr:`width` is called in reports."""
        return "body widths" if self.body else "channel widths"

    @property
    def first_outline(self) -> Array | None:
        """:attr:`outline`; None where there is no body in the channel."""
        return self.outline if self.body else None

    @property
    def outline(self) -> Array:
        """Corners (k, 2) of the first body (m), which the feed falls on. Raises LookupError without one."""
        return list(self.body.values())[0].outline()  # noqa: RUF015  of a scene without a body an error of ours

    @property
    def level(self) -> float:
        """y (m) down to which the feed falls freely: the first body's top, or where the curtain enters without one."""
        if self.body:
            return float(self.outline[:, 1].max())
        return self.channel.top if self.feed.level is None else self.feed.level

    @property
    def plumb(self) -> Plumb:
        """Where down is, and how the feed hangs."""
        channel, half = self.channel, 0.5 * self.channel.width
        pivot = self.feed.position, self.level
        return Plumb(channel.tilt, pivot, -half, half, channel.bottom, channel.top, self.gravity)

    @property
    def drop(self) -> float:
        """How far (m) it is along gravity from :attr:`level` to the channel's end, its floor or a wall."""
        plumb = self.plumb
        return self.level - self.channel.bottom if plumb.upright else plumb.way(plumb.down)

    @property
    def reynolds(self) -> float:
        """Re = rho U D / mu on the first body's width (the channel's without one); 0 in a vacuum."""
        return 0.0 if self.air is None else self.air.density * self.air.speed * self.width / self.air.viscosity

    @property
    def motion(self) -> tuple[Array, float]:
        """Amplitude vector (2,) m and angular frequency (rad/s) of the bodies; zeros when at rest. For samples these
        are the largest displacement and the frequency of their period, of bodies that rock those of the farthest place.
        """
        return (np.zeros(2), 0.0) if self.vibration is None else (self.vibration.displacement, self.vibration.omega)

    @property
    def shaking(self) -> Array:
        """Peak velocity vector (2,) m/s of the bodies; zeros when at rest."""
        return np.zeros(2) if self.vibration is None else self.vibration.speed

    @property
    def symmetric(self) -> bool:
        """Whether bodies and secondary streams are their own mirror image about x = 0, as the channel is."""
        rows = [(i.side, i.position, i.width, i.velocity) for i in self.channel.inlet.values()]
        opposite = {"left": "right", "right": "left"}
        paired = all((opposite[side], *rest) in rows for side, *rest in rows)
        return paired and are_symmetric([body.outline() for body in self.body.values()])

    @property
    def images(self) -> tuple[int, ...]:
        """The place of each bin's mirror image among the bins, that of elsewhere last; none where the bins, the
        machine, its motion, the feed, gravity or an airflow of the user's are not their own image about x = 0.
        """
        own_air = self.air is not None and self.air.case != ""
        motion = self.vibration
        still = motion is None or (motion.pivot is None and abs(float(motion.along[0])) < LENGTH_ROUNDING)
        if (
            not (self.symmetric and still and self.feed.symmetric and self.plumb.upright)
            or own_air
            or self.funnel is not None
        ):
            return ()
        lines = [(place.line(self), place.keeps_part) for place in self.bin.values()]
        result = [
            [i for i, other in enumerate(lines) if other[1] == keeps and _same_line(other[0], line * (-1.0, 1.0))]
            for line, keeps in lines
        ]
        return (*(item[0] for item in result), len(lines)) if all(result) else ()

    @property
    def collecting(self) -> dict[str, int]:
        """The bodies that keep what touches them, or a part of it, each with the place of its bin among the bins."""
        return {item.body: i for i, item in enumerate(self.bin.values()) if item.body is not None}

    def on_sides(self, side: str = "") -> dict[str, SideBin]:
        """The bins that are stretches of a ``side`` of the channel, or of any."""
        return {name: item for name, item in self.bin.items() if isinstance(item, SideBin) and side in ("", item.on)}

    @property
    def all_kept(self) -> list[str]:
        """The bodies that keep all that touches them."""
        return [item.body for item in self.bin.values() if item.body is not None and item.keeps_part == 1.0]

    @property
    def products(self) -> list[str]:
        """The bins that are a target of some fraction."""
        return [name for name in self.bin if any(name in item.targets for item in self.fraction.values())]

    @property
    def release(self) -> tuple[float, float]:
        """Height (m) above :attr:`level`, against gravity, at which the curtain begins, and its fall speed (m/s) there.

        With feed.speed it begins at most one body width above, with the speed that free fall turns into feed.speed at
        the top. Without a body it begins at the level itself, with its own speed.
        """
        feed = self.feed
        if not self.body:
            return 0.0, float(self.entry @ self.plumb.down)
        if feed.speed is None:
            return feed.height, 0.0
        above = min(feed.speed**2 / (2 * self.gravity), self.width)
        return above, math.sqrt(max(0.0, feed.speed**2 - 2 * self.gravity * above))

    @property
    def entry(self) -> Array:
        """Velocity (2,) m/s with which the curtain comes to :attr:`level`, without air."""
        angle = self.feed.direction
        if angle is None:
            return self.feed.fall_speed * self.plumb.down
        return self.feed.fall_speed * np.array([math.cos(angle), math.sin(angle)])

    @property
    def obstacles(self) -> list[str]:
        """Names of the bodies, other than the first, that the falling curtain may meet before it meets the first."""
        if not self.body:
            return []
        first, *others = ((name, body.outline()) for name, body in self.body.items())
        reach = self.feed.width / 2 + max(float(f.diameters(np.array([0.999]))[0]) for f in self.fraction.values())
        result = []
        for name, outline in others:
            (left, _), (right, high) = outline.min(axis=0), outline.max(axis=0)
            beside = left > self.feed.position + reach or right < self.feed.position - reach
            if not beside and high > first[1][:, 1].min():
                result.append(name)
        return result

    def mass_shares(self) -> dict[str, float]:
        """Share of every fraction in the feed, by mass; they add up to 1."""
        return {name: each.mass_share or 1.0 / len(self.fraction) for name, each in self.fraction.items()}
