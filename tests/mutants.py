"""Faults seeded one at a time into a copy of the program: which of them do the tests notice? python tests/mutants.py

Texts are looked for in all of src and tests by their names, so that files may move; kernels run uncompiled.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Mutant(NamedTuple):
    """``old`` text, which ``new`` replaces, and the ``tests`` of which at least one must fail, with their case."""

    fault: str
    old: str
    new: str
    tests: str


MUTANTS = [
    Mutant("shear lift to the other side", "lift = grain[at.LIFT] * lift_", "lift = -grain[at.LIFT] * lift_",
           "test_landing_errors_stay_below_the_tolerance[0.05-forces1]"),
    Mutant("twice the drag at high Reynolds numbers", "0.15 * re**0.681 + 0.407", "0.15 * re**0.681 + 0.814",
           "test_published_drag_coefficients"),
    Mutant("rebound into the wall", "vx + normal * nx - along * ny,", "vx - normal * nx - along * ny,",
           "test_impulses_are_the_changes_of_velocity"),
    Mutant("pressure with 2k/3", "pressure_faces = pressure - 2 / 3 * k,", "pressure_faces = pressure,",
           "test_edges_of_a_no_slip_wall_have_p_itself_and_all_others_p_less_2k_over_3"),
    Mutant("quantile of the interval", "stdtrit(degrees, 0.975)", "stdtrit(degrees, 0.6)",
           "test_intervals_cover_the_mean_about_nineteen_times_in_twenty"),
    Mutant("elsewhere counts as the last bin", "np.where(self.bin >= 0, self.bin, bins)",
           "np.where(self.bin >= 0, self.bin, bins - 1)", "test_shares_purity_recovery_throughput"),
    Mutant("kg/h of kg/s by 60", "{place: HOUR * joint.flow * mass for", "{place: 60.0 * joint.flow * mass for",
           "test_shares_purity_recovery_throughput"),
    Mutant("bins not weighted by mass", "float((joint.mass * self.value[:, i]).sum())",
           "float(self.value[:, i].mean())", "test_shares_purity_recovery_throughput"),
    Mutant("phases not weighted by W / V0", "flow = closing * np.cos(b) * flow",
           "flow = np.asarray(fall_speed) * np.cos(b) * flow", "test_a_harmonic_stream_has_the_closed_means"),
    Mutant("one seed for all replicates", "zlib.crc32(name.encode()), replicate, *apart])",
           "zlib.crc32(name.encode()), 0, *apart])", "test_replicates_are_equal_in_size_and_independent"),
    Mutant("the field's key forgets the strength", "self.steady.key, *numbers,", "self.steady.key, numbers[0],",
           "test_the_answer_flies_between_the_ends_and_every_number_is_in_the_key"),
    Mutant("damaged stages are used", "digest_of(folder / name) == digest for", "bool(digest) for",
           "test_a_damaged_stage_is_made_again"),
    Mutant("the newest stages are cleaned first", "(stage.finished, stage.used))", "(stage.finished, -stage.used))",
           "test_the_oldest_go_until_little_enough_is_left"),
    Mutant("half a domain mirrored without its sign", "half[..., off, :] * (-1.0, 1.0)", "half[..., off, :]",
           "test_a_mirrored_field_is_its_own_mirror_image"),
    Mutant("Strouhal number by the period", 'parts["strouhal"] = _inverse(length)', 'parts["strouhal"] = length',
           "test_a_periodic_wake_needs_six_periods_and_says_so_small_an_interval_as_was_resolved"),
    Mutant("errors of a share simply added", "math.hypot(*(part.size for part in computed))",
           "math.fsum(part.size for part in computed)", "test_the_numerical_part_is_neither_inputs_nor_bounds"),
    Mutant("Cunningham's slip makes drag larger", "return 1.0 + knudsen *", "return 1.0 - knudsen *",
           "test_slip_correction_of_air"),
    Mutant("theta from the wrong end", "return (x - self.steady) / (", "return (self.resolved - x) / (",
           "test_a_number_between_the_ends_says_theta_and_a_fluctuation_the_strength"),
    Mutant("a measured vibration drifts", "v -= _moved(v, a, h).sum() / period", "v -= 0.0 / period",
           "test_samples_at_any_spacing_are_integrated_exactly"),
    Mutant("granules touch with their centre", "(end[0] - start[0]) + outward[1] * radius", "(end[0] - start[0])",
           "test_a_granule_touches_the_outline_at_its_radius"),
    Mutant("buoyancy downward", "gravity: -((air.density / grains.density)", "gravity: ((air.density / grains.density)",
           "test_buoyancy_and_pressure_gradient_have_their_signs_and_sizes"),
]  # fmt: skip


def main() -> None:
    """Report every mutant by its fault; exit with 1 where one survives, or is no longer there."""
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(shutil.copytree(ROOT / "src", Path(folder, "src")))
        for mutant in MUTANTS:
            said = outcome(mutant, copy)
            missed += said != "killed"
            print(f"{said:9} {mutant.fault}", flush=True)
    print(f"{len(MUTANTS) - missed} of {len(MUTANTS)} killed")
    sys.exit(missed > 0)


def outcome(mutant: Mutant, copy: Path) -> str:
    """What becomes of one in the ``copy``, which is left as it was."""
    holds, tests = places(mutant, copy), found(mutant.tests)
    if len(holds) != 1 or not tests:
        return "not found"
    text = holds[0].read_text()
    holds[0].write_text(text.replace(mutant.old, mutant.new))
    env = {**os.environ, "PYTHONPATH": str(copy), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-W", "ignore", *tests]
    try:
        done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True)
    finally:
        holds[0].write_text(text)
    return {0: "SURVIVED", 1: "killed"}.get(done.returncode, done.stdout[-400:])


def places(mutant: Mutant, folder: Path) -> list[Path]:
    """The modules below ``folder`` that hold the text which it replaces."""
    return [path for path in folder.rglob("*.py") if mutant.old in path.read_text()]


def found(names: str) -> list[str]:
    """The tests of these names, as pytest wants them: file::function, or file::class::method."""
    files = {path: path.read_text() for path in (ROOT / "tests").rglob("test_*.py")}
    return [
        "::".join([str(path), *re.findall(r"^class (\w+)", text[: at.start()], re.M)[-1:] * bool(at[1]), name])
        for name in names.split()
        for path, text in files.items()
        for at in re.finditer(rf"^( *)def {name.partition('[')[0]}\(", text, re.M)
    ]


if __name__ == "__main__":
    main()
