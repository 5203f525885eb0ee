"""[collisions]: how granules meet each other, in the slab of the machine in which every one of them is a real one."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .table import Table
from .units import Length

__all__ = ["Crowding"]


class Crowding(Table):
    """[collisions]: granules among themselves; whether their meetings are computed the plan decides, or --force."""

    depth: Length | None = Field(
        None, description="of the slab across the picture, periodic; default 15 of the coarsest granules' diameters"
    )
    count: Annotated[int, Field(ge=16, le=10_000_000)] | None = Field(
        None, description="granules of a fraction that count in the slab; default what numerics.target_error needs"
    )
    restitution: Annotated[float, Field(ge=0, le=1)] = Field(0.5, description="of one granule on another")
    friction: Annotated[float, Field(ge=0, le=10)] = Field(0.3, description="of one granule on another")
