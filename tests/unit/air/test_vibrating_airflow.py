"""The vibrating body in the air: the moving mesh against exact references, its loop, what is left out and why."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import kv

from proofs.validation_page import record_of
from support import RHOMBUS, WIDTH, kept_airflow
from wakeflow.air.field import FlowField
from wakeflow.air.foam.case import FlowSpec, MeshMotion, set_patch_types, write_case, write_parameters
from wakeflow.air.foam.programs import call
from wakeflow.air.foam.read import CaseFields, loop_of, read_flow, time_folders
from wakeflow.air.foam.solver import holds_a_state
from wakeflow.air.foam.start import prepare_case, write_internal
from wakeflow.air.foam.statistics import CD, CL, Tail, read_table
from wakeflow.air.foam.time_resolved import best_loop
from wakeflow.air.mesh import build_mesh, plan_mesh
from wakeflow.core.errors import FoamError, SceneError
from wakeflow.core.record import to_json
from wakeflow.planning.airflow_choice import (
    SHARES_MOVED,
    AirMotion,
    frequency_ratios,
    vibration_of_air,
    vibration_of_scene,
)
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene


def flow(outline: np.ndarray, vibration: MeshMotion | None = None, *, scale: float = 2.5, **how: Any) -> FlowSpec:
    """A body in a channel ten times as wide, laminar, Re 100 unless told otherwise, on 1600 cells."""
    ends = {"top": 5 * WIDTH, "bottom": -12 * WIDTH}
    mesh = plan_mesh([outline], width=10 * WIDTH, direction="down", rung="standard", scale=scale, **ends)  # type: ignore[arg-type]
    air = {"speed": 1.0, "density": 1.2, "viscosity": 1.2 * WIDTH / 100, **how}
    return FlowSpec(mesh, **air, turbulence="laminar", stepping="time-resolved", vibration=vibration)


def forces(spec: FlowSpec, folder: Path, end: float, step: float, change: Callable[[Path], None] | None = None) -> Any:
    """(time, Cd, Cl) of the flow run for ``end`` seconds from its start in time steps of at most ``step`` (s)."""
    build_mesh(spec.mesh, folder)
    case = folder / "case"
    case.mkdir()
    prepare_case(spec, folder / "mesh.msh", case)
    if change:
        change(case)
    values = {"endTime": end, "deltaT": step, "maxDeltaT": step, "writeControl": "adjustableRunTime"}
    write_parameters(case, {**values, "writeInterval": end / 2})
    call(case, ["pimpleFoam"])  # without a watch: against still air every drag coefficient is absurd
    return read_table(case, "forceCoefficients", (CD, CL)).T


class TestMovingMesh:
    pytestmark = pytest.mark.openfoam

    def test_swinging_cylinder_in_still_air_feels_stokes_force(self, tmp_path: Path) -> None:
        """Stokes 1851, a << D: F = -rho A G y'' with G = 1 + 4 K1(z) / (z K0(z)), z = (D/2) sqrt(i w / nu).

        At D^2 f / nu = 50 added mass 1.32 and damping 0.34. Slip walls a distance H apart are a row of images, which
        speed the air at the cylinder up by 1 + e, e = (pi D / H)^2 / 12: the inviscid added mass becomes 1 + 2 e, the
        thin Stokes layer's force grows by (1 + e)^2; 1.6 % here.
        """
        nu, beta, corners = 1e-3, 50.0, 40
        omega = 2 * np.pi * beta * nu / WIDTH**2
        swing = MeshMotion(0.008 * WIDTH, omega)
        angle = 2 * np.pi * (np.arange(corners) + 0.5) / corners
        radius = WIDTH / 2 * np.sqrt(np.pi / (corners / 2 * np.sin(2 * np.pi / corners)))  # of the same area
        outline = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        still = 1e-3 * swing.peak_speed
        spec = flow(outline, swing, scale=1.0, speed=still, viscosity=1.2 * nu)
        time, drag, lift = forces(spec, tmp_path, 2.5 * swing.period, swing.period / 96)
        late = time > 1.5 * swing.period
        force = -drag * 0.5 * still**2 * spec.mesh.projected_width  # along y; drag points down
        area = np.pi * WIDTH**2 / 4
        waves = np.column_stack([np.sin(omega * time), np.cos(omega * time), np.ones_like(time)])[late]
        inertia, damping, _ = np.linalg.lstsq(waves, force[late], rcond=None)[0] / (area * swing.amplitude * omega**2)
        z = WIDTH / 2 * np.sqrt(1j * omega / nu)
        image = (np.pi / 10) ** 2 / 12
        exact = 1 + 2 * image + 4 * kv(1, z) / (z * kv(0, z)) * (1 + image) ** 2
        assert inertia == pytest.approx(exact.real, rel=0.03)
        assert -damping == pytest.approx(-exact.imag, rel=0.05)
        assert np.abs(lift[late]).max() < 0.02 * np.abs(drag[late]).max()

    def test_moving_mesh_is_the_accelerated_frame_and_goes_on_after_a_stop(self, tmp_path: Path) -> None:
        """The same flow seen from the body: mesh at rest, inlet at U - d', and rho A d'' of displaced air."""
        vibration = MeshMotion(0.1 * WIDTH, 2 * np.pi * 7.5)
        end, step = 0.4, vibration.period / 96
        moving = replace(flow(RHOMBUS, vibration, scale=2.2), max_courant=1.0)

        def ride(case: Path) -> None:
            path = case / "0" / "U"
            sine = (
                f"uniformValue sine; uniformValueCoeffs {{ t0 {-vibration.period / 4:.12g}; "
                f"frequency {1 / vibration.period:.12g}; amplitude {-vibration.peak_speed:.12g}; scale (0 1 0); "
                "level (0 -1 0); }"
            )
            inlet = f"inlet {{ type uniformFixedValue; {sine} }}"
            path.write_text(re.sub(r"\$inletsU;", inlet, path.read_text()))
            cells = json.loads((case.parent / "mesh.json").read_text())["cells"]
            write_internal(path, np.tile([0.0, -1.0 - vibration.peak_speed], (cells, 1)))

        a, b = (tmp_path / name for name in ("moving", "ridden"))
        seen = forces(moving, a, end, step)
        ridden = forces(replace(moving, vibration=None), b, end, step, ride)
        displaced = WIDTH**2 / 2 * vibration.amplitude * vibration.omega**2 / (0.5 * WIDTH)
        clock = np.linspace(0.1, end, 500)
        drag = np.interp(clock, seen[0], seen[1])
        other = np.interp(clock, ridden[0], ridden[1]) + displaced * np.sin(vibration.omega * clock)
        assert displaced > 0.5
        assert drag.std() > 0.5
        np.testing.assert_allclose(drag, other, atol=0.04 * drag.std())

        case = a / "case"
        middle, last = time_folders(case)
        whole = CaseFields(case).field(last, "U")[0]
        shutil.rmtree(last)
        call(case, ["pimpleFoam"])  # goes on from the middle, where the mesh stands elsewhere
        assert time_folders(case) == [middle, last]
        np.testing.assert_allclose(CaseFields(case).field(last, "U")[0], whole, atol=2e-3)

    @pytest.mark.parametrize("walls", ["slip", "no-slip"])
    def test_moving_mesh_leaves_the_air_as_it_is(self, tmp_path: Path, walls: str) -> None:
        """Without a body: uniform air between slip walls stays so; walls at rest drag on it as if nothing moved."""
        spec = flow(RHOMBUS, MeshMotion(0.1 * WIDTH, 40.0))
        spec = replace(spec, mesh=replace(spec.mesh, walls=walls))  # type: ignore[arg-type]
        fields = {}
        for name, vibration in (("moving", spec.vibration), ("resting", None)):
            case = tmp_path / name
            case.mkdir()
            write_case(replace(spec, vibration=vibration), case)
            (case / "system" / "blockMeshDict").write_text(CHANNEL)
            call(case, ["blockMesh"])
            set_patch_types(case, walls=walls)
            steps = {"deltaT": 0.01, "maxDeltaT": 0.01, "writeControl": "adjustableRunTime", "writeInterval": 0.6}
            write_parameters(case, {"endTime": 0.6, **steps})
            call(case, ["pimpleFoam"])
            read = CaseFields(case)
            last = read.folder("latest")
            fields[name] = [read.field(last, field)[0] for field in ("U", "p")]
        (velocity, pressure), (still, rest) = fields["moving"], fields["resting"]
        if walls == "slip":
            np.testing.assert_allclose(velocity, np.broadcast_to([0, -1], velocity.shape), atol=1e-6)
            np.testing.assert_allclose(pressure, 0, atol=1e-6)
        else:
            along = read.mesh.plane.centres[:, 1] < 0.15  # the boundary layers begin where the inlet now is
            assert np.ptp(still[along, 1]) > 0.5
            np.testing.assert_allclose(velocity[along], still[along], atol=0.01)
            np.testing.assert_allclose(pressure[along], rest[along], atol=0.02 * np.ptp(rest))


CHANNEL = """
FoamFile { version 2.0; format ascii; class dictionary; object blockMeshDict; }
vertices
(
    (-0.1 -0.3 0) (0.1 -0.3 0) (0.1 0.3 0) (-0.1 0.3 0) (-0.1 -0.3 0.1) (0.1 -0.3 0.1) (0.1 0.3 0.1) (-0.1 0.3 0.1)
);
blocks (hex (0 1 2 3 4 5 6 7) (16 24 1) simpleGrading (1 1 1));
boundary
(
    inlet { type patch; faces ((3 7 6 2)); }
    outlet { type patch; faces ((0 1 5 4)); }
    left { type patch; faces ((0 4 7 3)); }
    right { type patch; faces ((1 2 6 5)); }
    back { type empty; faces ((0 3 2 1)); }
    front { type empty; faces ((4 5 6 7)); }
);
"""


@pytest.fixture(scope="module")
def locked() -> tuple[FlowSpec, Path, Any]:
    """Vibration at twice the shedding frequency, a w / U = 0.2: every second vibration sheds a pair of vortices."""
    omega = 2 * np.pi * 7.5
    spec = flow(RHOMBUS, MeshMotion(0.2 / omega, omega), scale=3.5, accuracy=0.2)
    folder, result = kept_airflow(spec)
    return spec, folder / "case", result


class TestLoop:
    pytestmark = pytest.mark.openfoam

    def test_loop_is_whole_vibrations_and_closes(self, locked: tuple[FlowSpec, Path, Any]) -> None:
        spec, case, result = locked
        vibration = spec.vibration
        loop = loop_of(case)
        vibrations = result.period / vibration.period
        assert vibrations == pytest.approx(round(vibrations), abs=1e-9)
        assert round(vibrations) % 2 == 0
        assert result.verdict == "periodic"
        assert result.loop_mismatch < 0.05
        clock = np.array([float(name) for name in loop["times"]])
        np.testing.assert_allclose(np.diff(clock), result.period / len(clock), rtol=1e-6)
        assert to_json(result.motion) == loop["motion"]
        assert result.motion.phase == 0.0  # as the scene's clock has it
        assert result.motion.amplitude == (0.0, vibration.amplitude)

    def test_nothing_is_lost_and_the_flow_rate_is_that_of_the_channel(self, locked: tuple[FlowSpec, Path, Any]) -> None:
        spec, _, result = locked
        assert abs(result.mass_error) < 1e-4
        assert result.flow_rate == pytest.approx(spec.speed * spec.mesh.width, rel=1e-4)

    def test_fields_are_on_the_reference_mesh_with_the_velocity_of_the_walls(
        self, locked: tuple[FlowSpec, Path, Any]
    ) -> None:
        spec, case, result = locked
        *kept, last = time_folders(case)
        assert not [path for path in kept if (path / "polyMesh").exists()]
        assert (last / "polyMesh" / "points").exists()  # the run can go on
        every = read_flow(case, "all")
        x, y = every["points"].T
        on_body = np.abs(np.abs(x) + np.abs(y) - WIDTH / 2) < 1e-9
        assert on_body.sum() > 20
        motion = result.motion
        speed = motion.amplitude[1] * motion.omega * np.cos(motion.omega * every["times"] + motion.phase)
        assert np.ptp(speed) > 0.3
        wall = every["velocity"][:, on_body]
        half_a_step = np.pi / 48 * 0.2  # OpenFOAM takes the wall's tangential velocity from the middle of the time step
        np.testing.assert_allclose(wall[..., 1], np.broadcast_to(speed[:, None], wall.shape[:2]), atol=half_a_step)
        np.testing.assert_allclose(wall[..., 0], 0, atol=half_a_step)
        inlet = y > y.max() - 1e-9
        np.testing.assert_allclose(every["velocity"][:, inlet, 1], -1, atol=1e-3)
        field = FlowField.from_openfoam(case, "all")
        assert field.motion == (0.0, spec.vibration.amplitude, spec.vibration.omega, 0.0)

    def test_a_time_without_its_points_is_not_whole(self, locked: tuple[FlowSpec, Path, Any], tmp_path: Path) -> None:
        _, case, _ = locked
        copy = tmp_path / "case"
        last = time_folders(case)[-1]
        shutil.copytree(case / "system", copy / "system")
        for name in (last.name, "1000"):
            shutil.copytree(last, copy / name)
        (copy / "1000" / "polyMesh" / "points").unlink()
        assert [path.name for path in time_folders(copy) if holds_a_state(copy, path)] == [last.name]

    def test_another_run_goes_on_from_the_loops_begin(self, locked: tuple[FlowSpec, Path, Any]) -> None:
        """In the same phase of the vibration, as both clocks have it: the first vibrations are as the last ones."""
        spec, case, result = locked
        whole = spec.vibration.period
        folder, again = kept_airflow(spec, case.parent)
        assert again.verdict == "periodic"
        assert again.cl_rms.value == pytest.approx(result.cl_rms.value, rel=0.02)
        rows = Tail(folder / "case").update()
        late = rows[rows[:, 0] > rows[-1, 0] - 4 * whole]
        soon = rows[(rows[:, 0] > 2 * whole) & (rows[:, 0] < 6 * whole)]
        assert soon[:, 2].std() == pytest.approx(late[:, 2].std(), rel=0.05)


class TestChoice:
    def test_phase_is_that_of_the_loops_start(self) -> None:
        vibration = MeshMotion(2e-3, 50.0)
        motion = vibration.motion(1.234)
        for t in (0.0, 0.01, 0.3):
            there = motion["amplitude"][1] * np.sin(motion["omega"] * t + motion["phase"])  # type: ignore[index, operator]
            assert there == pytest.approx(vibration.displacement(1.234 + t), abs=1e-15)
        step = 1e-6
        slope = (vibration.displacement(0.2 + step) - vibration.displacement(0.2 - step)) / (2 * step)
        assert vibration.speed(0.2) == pytest.approx(slope, rel=1e-6)

    @pytest.mark.parametrize("longest", [0.3, 0.05, 0.013, 0.001])
    def test_snapshots_are_a_whole_number_a_vibration(self, longest: float) -> None:
        vibration = MeshMotion(1e-3, 2 * np.pi)
        step = vibration.cadence(longest)
        assert step <= longest * (1 + 1e-9)
        assert vibration.period / step == pytest.approx(round(vibration.period / step), abs=1e-9)
        assert round(vibration.period / step) >= 12

    def test_a_loop_of_whole_vibrations_even_where_another_closes_better(self) -> None:
        clock = 0.1 * np.arange(100)
        signal = np.sin(2 * np.pi * clock / 1.7)[:, None]  # repeats after 3.4, the vibration of 1 s after 5
        free = best_loop(clock, signal, 3.0)[2] / 1.7
        assert free == pytest.approx(round(free), abs=0.03)
        first, last, length, mismatch = best_loop(clock, signal, 3.0, 1.0)
        assert length == pytest.approx(round(length), abs=1e-12)
        assert clock[last] - clock[first] == pytest.approx(length)
        assert clock[first] == pytest.approx(round(clock[first]), abs=1e-12)
        assert mismatch < 0.8
        with pytest.raises(FoamError, match="shorter than a loop"):
            best_loop(clock, signal, 3.0, 20.0)

    def test_a_steady_airflow_does_not_vibrate(self) -> None:
        with pytest.raises(SceneError, match="rung standard"):
            replace(flow(RHOMBUS, MeshMotion(1e-3, 100.0)), stepping="steady")


class TestRule:
    @pytest.mark.parametrize("at", [1.0, 2.0])
    def test_used_near_the_shedding_frequency_and_twice_it_left_out_elsewhere(self, at: float) -> None:
        motion = vibration_of_air(0.08, at)
        assert motion.used
        assert f"near {at:g} fs" in motion.why
        beside = [vibration_of_air(0.08, ratio) for ratio in (0.3, 1.4, 3.5)]
        assert not any(motion.used for motion in beside)
        assert all(0 < motion.bound < 0.08 for motion in beside)

    def test_fast_vibration_is_always_used_and_a_feeble_one_never(self) -> None:
        assert all(vibration_of_air(0.3, ratio).used for ratio in (0.1, 1.0, 5.0))
        assert not any(vibration_of_air(0.01, ratio).used for ratio in (0.1, 1.0, 2.0, 5.0))
        assert vibration_of_air(0.01, 2.0, accuracy=0.001).used

    def test_the_band_widens_with_speed_and_a_range_counts_where_it_touches(self) -> None:
        assert not vibration_of_air(0.03, 1.8).used
        assert vibration_of_air(0.09, 1.8).used
        assert vibration_of_air(0.08, (1.3, 1.9)).used
        assert not vibration_of_air(0.08, (1.3, 1.5)).used

    def test_below_the_onset_of_shedding_nothing_locks(self) -> None:
        assert not vibration_of_air(0.08, 2.0, sheds=False).used
        assert vibration_of_air(0.3, 2.0, sheds=False).used

    def test_the_bound_covers_what_was_measured(self) -> None:
        """Every change of mean drag and base pressure in the record, locked or not, is below the bound."""
        (table,) = (one for one in record_of("Locked band")["table"] if one["head"][0] == "a w / U")
        rows = [(row[0], row[1], row[5].rstrip(" %"), row[7].rstrip(" %")) for row in table["rows"]]
        assert len(rows) > 12
        for speed, frequency, *changes in rows:
            motion = vibration_of_air(float(speed), float(frequency))
            if float(speed) <= 0.1:
                assert max(abs(float(change)) for change in changes) <= 100 * motion.bound, (speed, frequency)

    def test_what_shares_move_covers_what_was_measured_and_holds_for_that_machine_alone(self, cases: Path) -> None:
        rows = record_of("Air that sees the body vibrate")["table"][0]["rows"]
        moved = re.findall(r"([-+][\d.]+) ± ([\d.]+) (?:dust|chaff|wheat)", " ".join(row[-1] for row in rows))
        assert len(moved) == 6
        assert all(abs(float(change)) + 2.0 * float(error) < 100.1 * SHARES_MOVED for change, error in moved)
        scene = Scene.load(cases / "rhombus.toml")
        for changes, measured in (
            ({}, True), ({"vibration.gamma": 2.1}, False), ({"body.rhombus.slope_angle": "60 deg"}, False),
            ({"air.speed": "50 m/s"}, False), ({"vibration.direction": "80 deg"}, False),
        ):  # fmt: skip
            other = scene.replace(changes)
            motion = vibration_of_scene(other, 0.05)
            assert motion.moved == (SHARES_MOVED if measured else np.inf), changes
            doubts = " ".join(one.text for one in make_plan(other, rung="standard").notices)
            assert ("vibration-of-the-air, left out" in doubts) is not measured, changes

    def test_of_a_scene(self, cases: Path) -> None:
        scene = Scene.load(cases / "rhombus.toml")
        assert scene.vibration is not None
        low, high = frequency_ratios(scene, scene.vibration)
        assert low < 30 * 0.05 / 5 * 0.875 / 0.168 < high  # the rhombus' own, docs/validation.md
        motion = vibration_of_scene(scene)
        assert motion.bound < 0.05
        strong = scene.replace({"vibration.gamma": 8.0})
        assert vibration_of_scene(strong).used
        assert not vibration_of_scene(strong, switched=False).used
        assert vibration_of_scene(Scene.load(cases / "vacuum.toml")) == AirMotion()

    def test_sideways_vibration_that_could_lock_the_wake_is_refused(self, cases: Path) -> None:
        scene = Scene.load(cases / "rhombus.toml").replace({"vibration.direction": 0.0, "vibration.frequency": 20.0})
        with pytest.raises(SceneError, match=r"turn the vibration to 90 deg.*--force vibration-of-the-air=off"):
            vibration_of_scene(scene)
        assert not vibration_of_scene(scene, switched=False).used
        feeble = vibration_of_scene(scene.replace({"vibration.gamma": 0.1}))
        assert not feeble.used
        assert "sideways part is left out" in feeble.why
