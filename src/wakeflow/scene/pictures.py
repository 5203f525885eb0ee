"""[picture.NAME]: pictures that a scene asks for in addition to the usual ones, and the data behind them.

Each kind is a table here and a drawing function of the same name in ``show.asked_pictures``.
"""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field, model_validator

from ..core.errors import SceneError
from .table import UNSET, Coordinate, Length, Speed, Table

# figures of report.figures, in the order of the page: no picture takes a name
STANDARD_FIGURES = (
    "sketch", "pressure", "surface", "vorticity", "tracks", "residence", "discharge", "landing", "partition", "wakes",
    "measured", "inputs", "cost", "forces", "mesh",
)  # fmt: skip
TRACKS_RECORDED = 48  # tracks of each fraction that are drawn one by one
Quantity = Literal["time", "x", "y", "vx", "vy", "speed"]


class Picture(Table):
    """What all kinds share."""

    kind: str
    caption: Annotated[str, UNSET] = Field("", description="written under the picture in the report")
    fractions: Annotated[list[str], UNSET] = Field([], description="those that are drawn; default: all")

    @property
    def flown(self) -> tuple[int, float | None]:
        """How many granules of each fraction are flown for it, in full detail where they are few, and the upward speed
        (m/s) of the body that one more of them meets; 0: it draws no tracks.
        """
        return getattr(self, "granules", 0), None

    def chosen(self, names: list[str]) -> list[str]:
        """Which of the fractions are drawn."""
        return self.fractions or names


class Curves(Picture):
    """kind = "curves": one quantity of each granule over another."""

    kind: Literal["curves"]
    granules: Annotated[int, Field(ge=1, le=4096)] = Field(TRACKS_RECORDED, description="granules of each fraction")
    x: Quantity = Field("time", description="quantity on the horizontal axis")
    y: Quantity = Field("x", description="quantity on the vertical axis")
    origin: Literal["separation", "scene"] = Field(
        "separation", description="separation: time and place are counted from the last contact with a body"
    )
    drop: Annotated[Length, UNSET] = Field(0.0, description="curves end this far below the separation; compared there")
    body_speed: Speed | None = Field(
        None, description="upward speed of the body: beside all phases, one granule of the feed that met nearly this"
    )

    @model_validator(mode="after")
    def _drop_needs_an_origin(self) -> Curves:
        if self.drop and self.origin != "separation":
            raise SceneError("drop is counted from the separation: leave origin out")
        if self.x == self.y:
            raise SceneError(f"x and y are both {self.x}")
        return self

    @property
    def flown(self) -> tuple[int, float | None]:
        return self.granules, self.body_speed


class Streamlines(Picture):
    """kind = "streamlines": pressure and streamlines of the mean air, with the zones marked and numbered."""

    kind: Literal["streamlines"]


class Density(Picture):
    """kind = "density": where the mass of each fraction flows, over the suction zone's outline."""

    kind: Literal["density"]
    granules: Annotated[int, Field(ge=1, le=4096)] = Field(512, description="tracks that are added up")
    cell: Annotated[Length, UNSET] = Field(
        0.0, description="edge of a cell of the map; default: an eighth of the body's width"
    )


class Levels(Picture):
    """kind = "levels": mass flow, mean velocity and spread of each fraction where it passes given heights."""

    kind: Literal["levels"]
    levels: Annotated[list[Coordinate], Field(min_length=1, max_length=200)] = Field(description="heights y")
    granules: Annotated[int, Field(ge=32, le=4096)] = Field(1024, description="granules of each fraction")


AnyPicture = Annotated[Curves | Streamlines | Density | Levels, Field(discriminator="kind")]


def picture_tables() -> dict[str, type[Picture]]:
    """The kinds of pictures by name."""
    kinds = get_args(get_args(AnyPicture)[0])
    return {get_args(kind.model_fields["kind"].annotation)[0]: kind for kind in kinds}
