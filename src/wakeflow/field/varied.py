"""The same airflow at another speed, or with other turbulence: what uncertain numbers of the air make of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from .flow import NODAL, FlowField

__all__ = ["varied"]


def varied(field: FlowField, speed: float = 1.0, energy: float = 1.0, lifetime: float = 1.0) -> FlowField:
    """``field`` with the factor ``speed`` on its velocity, ``energy`` on the kinetic energy of its turbulence beside
    that, ``lifetime`` on that of the eddies k / dissipation beside both.

    By similarity at an unchanged Reynolds number: pressure and k go with the speed's square, dissipation with its cube,
    times with its inverse, so that the Strouhal number stays; a length scale k^3/2 / dissipation stays where the energy
    changes. That the flow itself does not change with its Reynolds number holds for some per cent about the computed
    one. On a mesh that swings with the body the clock stays, which is the vibration's.
    """
    factors = {
        "velocity": speed,
        "pressure": speed**2,
        "given_gradient": speed**2,
        "k": energy * speed**2,
        "dissipation": energy**1.5 * speed**3 / lifetime,
    }
    made: dict[str, Any] = {
        name: factors[name] * values for name in NODAL if (values := getattr(field, name)) is not None
    }
    if field.times is not None and field.motion is None:
        made["times"] = field.times / speed
        made["period"] = None if field.period is None else field.period / speed
    return replace(field, **made)
