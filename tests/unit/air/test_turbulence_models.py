"""Turbulence models: every record holds together, and a model that the program does not know is added as one."""

import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from pages import blocks
from support import DOCS
from wakeflow.air.foam import case as case_module
from wakeflow.air.foam.airflow import solve_airflow
from wakeflow.air.foam.case import MODELS, FlowSpec, write_case
from wakeflow.air.foam.read import CaseFields, read_flow
from wakeflow.air.foam.start import start_from
from wakeflow.air.mesh import build_mesh, plan_mesh
from wakeflow.core.errors import FoamError, SceneError
from wakeflow.core.files import case_template
from wakeflow.laws.constants import C_MU
from wakeflow.laws.shape import shapes
from wakeflow.laws.turbulence import (
    KINETIC_ENERGY,
    NUT,
    OMEGA,
    TurbulenceField,
    TurbulenceModel,
    has_no_turbulence,
    model_at,
    turbulence_models,
)

OWN_FILES = Path(__file__).parent / "turbulence-models"


def rhombus(turbulence: str, scale: float = 2.5) -> FlowSpec:
    body = shapes["rhombus"](width=0.05, slope_angle=math.pi / 4)
    mesh = plan_mesh([body], width=0.3, top=0.25, bottom=-0.45, names=["rhombus"], scale=scale)
    return FlowSpec(mesh, 5.0, 1.204, 1.825e-5, turbulence=turbulence)


@pytest.fixture
def realizable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TurbulenceModel:
    """The model registered for one test, its files in a copy of the template."""
    monkeypatch.setattr(turbulence_models, "_entries", dict(turbulence_models._entries))
    template = tmp_path / "template"
    shutil.copytree(case_template(), template)
    shutil.copytree(OWN_FILES, template / MODELS, dirs_exist_ok=True)
    monkeypatch.setattr(case_module, "case_template", lambda: template)
    (code,) = [block.body for block in blocks(DOCS / "extending.md") if block.heading == "A turbulence model"]
    exec(code, {})
    return turbulence_models["realizableKE"]


def epsilon(model: TurbulenceModel) -> TurbulenceField:
    return next(field for field in model.fields if field.name == "epsilon")


@pytest.mark.parametrize("name", list(turbulence_models))
def test_a_model_holds_together(name: str, tmp_path: Path) -> None:
    model = turbulence_models[name]
    assert model.name == name
    assert model.means
    assert model.source
    fields = {field.name for field in model.fields}
    assert bool(fields) == (model.dissipation is not None) == model.turbulent
    assert model.dissipation is None or {"k", model.dissipation.field} <= fields
    assert all(field.entering(0.1, 0.3) > 0 for field in model.transported)
    write_case(rhombus(name), tmp_path)
    assert fields <= {path.name for path in (tmp_path / "0").iterdir()}
    assert not (tmp_path / MODELS).exists()


@pytest.mark.parametrize("reynolds", [1e-6, 1.0, 299.9, 300.0, 1e9])
def test_the_plan_finds_one_model_at_every_reynolds_number(reynolds: float) -> None:
    models = (turbulence_models[name] for name in turbulence_models)
    assert [model for model in models if model.reynolds[0] <= reynolds < model.reynolds[1]] == [model_at(reynolds)]
    assert model_at(reynolds).turbulent == (reynolds >= 300.0)


def test_words_that_are_no_model_bring_turbulence() -> None:
    found = [name for name in ("laminar", "kOmegaSST", "given", "decaying", None) if has_no_turbulence(name)]
    assert found == ["laminar"]


def test_fields_scale_with_their_units(realizable: TurbulenceModel) -> None:
    """k with U^2, omega with U / L, epsilon with U^3 / L, the eddy viscosity with U L."""
    assert KINETIC_ENERGY.rescaled(2.0, 3.0) == 4.0
    assert OMEGA.rescaled(2.0, 3.0) == 2.0 / 3.0
    assert epsilon(realizable).rescaled(2.0, 3.0) == 8.0 / 3.0
    assert NUT.rescaled(2.0, 3.0) == 6.0


def test_both_ways_to_give_the_dissipation_agree_on_the_inlet(realizable: TurbulenceModel) -> None:
    entering = epsilon(realizable).entering
    assert C_MU * 0.1 * OMEGA.entering(0.1, 0.3) == pytest.approx(entering(0.1, 0.3))


def test_an_unknown_model_and_one_without_its_files_are_named(
    realizable: TurbulenceModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SceneError, match=r"unknown turbulence model 'kOmega'; did you mean 'kOmegaSST'"):
        rhombus("kOmega")
    monkeypatch.setattr(case_module, "case_template", case_template)
    with pytest.raises(FoamError, match=r"no 0/epsilon for realizableKE: put it into .*realizableKE"):
        write_case(rhombus(realizable.name), tmp_path / "case")


@pytest.mark.openfoam
def test_a_new_model_is_solved_checked_and_read_back(realizable: TurbulenceModel, tmp_path: Path) -> None:
    spec = rhombus(realizable.name)
    build_mesh(spec.mesh, tmp_path)
    case = tmp_path / "case"
    result = solve_airflow(spec, tmp_path / "mesh.msh", case)
    assert (result.turbulence, result.settings, result.verdict) == ("realizableKE", "normal", "steady")
    assert 1.2 < result.cd.value < 2.2
    assert {"largest k", "largest epsilon", "largest nut"} <= set(result.checks)
    assert {"k", "epsilon"} <= set(result.residuals)

    fields = CaseFields(case)
    latest = fields.folder("latest")
    shot = fields.snapshot(latest)
    assert fields.model is realizable
    np.testing.assert_array_equal(shot.cells["dissipation"], fields.field(latest, "epsilon")[0])
    np.testing.assert_allclose(
        shot.cells["pressure"], fields.field(latest, "p")[0] - 2 / 3 * fields.field(latest, "k")[0]
    )
    flow = read_flow(case)
    at_inlet = flow["points"][:, 1] > spec.mesh.top - 1e-9
    k = 1.5 * (spec.intensity * spec.speed) ** 2
    entering = epsilon(realizable).entering
    np.testing.assert_allclose(flow["k"][at_inlet], k, rtol=2e-3)  # long cells at the corners
    assert np.median(flow["dissipation"][at_inlet]) == pytest.approx(entering(k, 0.3), rel=0.2)

    faster = FlowSpec(spec.mesh, 10.0, 1.204, 1.825e-5, turbulence=realizable.name)
    write_case(faster, tmp_path / "next")
    shutil.copytree(case / "constant" / "polyMesh", tmp_path / "next" / "constant" / "polyMesh", dirs_exist_ok=True)
    start_from(faster, tmp_path / "next", case)
    listed = re.search(r"List<scalar>\n\d+\n\((.*?)\n\);", (tmp_path / "next" / "0" / "epsilon").read_text(), re.S)
    started = np.array(listed[1].split(), dtype=float)
    np.testing.assert_allclose(started, 8.0 * fields.field(latest, "epsilon")[0], rtol=1e-6)
