"""How a granule's velocity relaxes to that of steady uniform air: one exponential step of its flight."""

from __future__ import annotations

from typing import Any

__all__ = ["relaxed"]


def relaxed(velocity: Any, final: Any, tau: Any, step: Any, left: Any) -> tuple[Any, Any]:
    """Way (m) and velocity (m/s) after ``step`` (s) of v' = (final - v) / tau, exactly.

    ``velocity`` m/s, of any component; ``final`` m/s: that of the air, and tau times what else accelerates the granule;
    ``tau`` s; ``left`` exp(-step / tau), which the caller knows. Numbers or arrays, which broadcast.
    """
    return final * step + (velocity - final) * tau * (1.0 - left), final + (velocity - final) * left
