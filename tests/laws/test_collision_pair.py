"""Two granules and the same law of impulses: what is conserved, what never grows, and the wall as a limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wakeflow.laws.collision import collide, collide_pair

Array = NDArray[np.float64]
MANY = 4096


def _unit(rng: np.random.Generator) -> Array:
    n = rng.normal(size=(MANY, 3))
    return np.asarray(n / np.linalg.norm(n, axis=1)[:, None])


def _pairs(seed: int, mobility: Any = None) -> dict[str, Any]:
    """Pairs of all masses and radii up to 1000 : 1, of any spin and slip."""
    rng = np.random.default_rng(seed)
    turning = rng.choice([2.5, 2.0, 1.5, 1.0], (2, MANY)) if mobility is None else np.full((2, MANY), mobility)
    return {
        "m": 10 ** rng.uniform(-9, 0, (2, MANY)), "r": 10 ** rng.uniform(-5, -2, (2, MANY)), "n": _unit(rng),
        "v": rng.normal(size=(2, MANY, 3)), "w": rng.normal(size=(2, MANY, 3)) * 100, "q": turning,
        "e": rng.choice([0.0, 1.0, 0.3, 0.85], MANY), "f": rng.choice([0.0, 0.1, 0.5, np.inf], MANY),
        "back": rng.choice([0.0, 0.4, 1.0], MANY),
    }  # fmt: skip


def _after(p: dict[str, Any]) -> tuple[Array, Array, Array]:
    """Velocities and spins (2, n, 3) after the collision, and the impulse (n, 3)."""
    s = (p["r"][:, :, None] * p["w"] * np.sign(p["q"])[:, :, None]).sum(axis=0)
    r, n = p["v"][0] - p["v"][1], p["n"]
    impulse = np.stack(
        collide_pair(*r.T, *s.T, *n.T, 1 / p["m"][0], 1 / p["m"][1], *p["q"], p["e"], p["f"], p["back"])[:3], axis=1
    )
    v = np.stack([p["v"][0] + impulse / p["m"][0, :, None], p["v"][1] - impulse / p["m"][1, :, None]])
    turn = np.cross(n, impulse)[None] * (p["q"] / (p["m"] * p["r"]))[:, :, None]
    return v, p["w"] - turn, impulse


def _energy(p: dict[str, Any], v: Array, w: Array) -> Array:
    inertia = np.where(p["q"] > 0, p["m"] * p["r"] ** 2 / np.maximum(p["q"], 1e-9), 0.0)
    return np.asarray((0.5 * p["m"] * (v**2).sum(axis=2) + 0.5 * inertia * (w**2).sum(axis=2)).sum(axis=0))


def test_angular_momentum_and_momentum_are_kept_to_round_off() -> None:
    p = _pairs(1)
    v, w, impulse = _after(p)
    change = p["m"][:, :, None] * (v - p["v"])
    size = np.linalg.norm(impulse, axis=1) + (p["m"][:, :, None] * np.abs(p["v"])).sum(axis=(0, 2))
    assert np.max(np.abs(change.sum(axis=0)) / size[:, None]) < 1e-14
    inertia = (p["m"] * p["r"] ** 2 / p["q"])[:, :, None]
    orbit = np.cross(p["n"] * p["r"][0, :, None], change[0]) - np.cross(p["n"] * p["r"][1, :, None], change[1])
    arm = (np.abs(p["w"]) * inertia).sum(axis=(0, 2)) + size * p["r"].sum(axis=0)
    assert np.max(np.abs(orbit + (inertia * (w - p["w"])).sum(axis=0)) / arm[:, None]) < 1e-14


@pytest.mark.parametrize("mobility", [None, 0.0])
def test_energy_never_grows(mobility: float | None) -> None:
    p = _pairs(2, mobility)
    before = _energy(p, p["v"], p["w"])
    v, w, _ = _after(p)
    assert np.all(_energy(p, v, w) <= before * (1 + 1e-13))


def test_smooth_elastic_pairs_keep_energy_and_restitution_turns_the_approach() -> None:
    p = _pairs(3) | {"f": np.zeros(MANY), "e": np.ones(MANY)}
    v, w, _ = _after(p)
    np.testing.assert_allclose(_energy(p, v, w), _energy(p, p["v"], p["w"]), rtol=1e-12)
    for e in (0.0, 0.4, 1.0):
        p["e"] = np.full(MANY, e)
        v, _, _ = _after(p)
        before, after = (((u[0] - u[1]) * p["n"]).sum(axis=1) for u in (p["v"], v))
        np.testing.assert_allclose(after, np.where(before < 0, -e * before, before), atol=2e-14)


def test_a_sticking_contact_turns_its_slip_round_by_the_tangential_restitution() -> None:
    p = _pairs(4) | {"f": np.full(MANY, np.inf)}
    p["n"] *= -np.sign(((p["v"][0] - p["v"][1]) * p["n"]).sum(axis=1))[:, None]
    v, w, _ = _after(p)

    def slip(u: Array, spin: Array) -> Array:
        g = u[0] - u[1] - np.cross((p["r"][:, :, None] * spin).sum(axis=0), p["n"])
        return np.asarray(g - (g * p["n"]).sum(axis=1)[:, None] * p["n"])

    before, after = slip(p["v"], p["w"]), slip(v, w)
    np.testing.assert_allclose(after, -p["back"][:, None] * before, atol=1e-12)


def test_a_wall_is_a_second_granule_of_no_inverse_mass() -> None:
    """In the plane the law of pairs is the wall's, for every mass of the granule."""
    p = _pairs(5)
    angle = np.random.default_rng(6).uniform(0, 2 * np.pi, MANY)
    nx, ny, none = np.cos(angle), np.sin(angle), np.zeros(MANY)
    (v, wall), spin, m, r, q = p["v"][:, :, :2], p["w"][0, :, 2], p["m"][0], p["r"][0], p["q"][0]
    laws = p["e"], p["f"], p["back"]
    vx, vy, turned, normal, _ = collide(*v.T, spin, nx, ny, *wall.T, *laws[:2], q, r, laws[2])
    jx, jy, jz, jn = collide_pair(*(v - wall).T, none, none, none, r * spin, nx, ny, none, 1 / m, none, q, none, *laws)
    np.testing.assert_allclose(v[:, 0] + jx / m, vx, atol=1e-13)
    np.testing.assert_allclose(v[:, 1] + jy / m, vy, atol=1e-13)
    np.testing.assert_allclose(jn / m, normal, atol=1e-13)
    np.testing.assert_allclose(r * spin - q / m * (nx * jy - ny * jx), r * turned, atol=1e-12)
    assert np.all(jz == 0.0)
