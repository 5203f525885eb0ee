"""Nothing that is read is run: no pickle of a folder that may come from others, no code in an OpenFOAM case."""

import gzip
import os
import pickle
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from support import RHOMBUS, WIDTH
from wakeflow.core.errors import SceneError
from wakeflow.core.foam_code import refuse_code
from wakeflow.core.record import save
from wakeflow.core.sources import kernel_root
from wakeflow.foam.airflow_result import CheckMesh
from wakeflow.foam.case import FlowSpec, write_case
from wakeflow.foam.prepare import CHECKED, prepare_case
from wakeflow.foam.start import start_from
from wakeflow.meshing import plan_mesh
from wakeflow.scene.own_files import find_case

HEADER = "FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
BINARY = HEADER.format(name="x").replace("ascii", "binary")


@pytest.fixture
def case(cases: Path, tmp_path: Path) -> Path:
    """The program's own template as a case that somebody has solved."""
    case = tmp_path / "case"
    for part in ("system", "constant", "0"):
        shutil.copytree(cases / "template" / part, case / part)
    shutil.copytree(case / "0", case / "500")
    (case / "constant" / "polyMesh").mkdir()
    (case / "constant" / "polyMesh" / "boundary").write_text("1(inlet { type patch; nFaces 1; startFace 1; })")
    (case / "system" / "parameters").write_text("stepping steady;\nsettings safer;\nnu 1.5e-5;\n")
    return case


def test_a_case_without_code_passes(case: Path) -> None:
    assert find_case(str(case), case) == case
    (case / "system" / "controlDict").write_text('functions { forces { type forces; libs ("libforces.so"); } }')
    refuse_code(case)


CODE = {
    "#codeStream": "value #codeStream { code #{ os << 1; #}; };",
    "#calc": 'speed #calc "1 + system(\\"id\\")";',
    "#eval": "speed #eval{ 1 + 1 };",
    "coded condition": "inlet { type codedFixedValue; name x; }",
    "coded function": "functions { f { type coded; } }",
    "code": "codeWrite #{ system(1); #};",
    "systemCall": 'functions { f { type systemCall; executeCalls ("id"); } }',
    "libs": 'libs ("../evil.so");',
    "absolute libs": 'libs\n(\n    "/anywhere/evil.so"\n);',
    "include of a file": '#include "/etc/passwd"',
    "include above": '#includeIfPresent "../../outside"',
    "include of a home": '#include "~/.ssh/id_rsa"',
    "include of a variable": '#include "$HOME/x"',
    "include of the installation": '#includeEtc "caseDicts/setConstraintTypes"',
}


@pytest.mark.parametrize("place", ["system/controlDict", "constant/transportProperties", "500/U"])
@pytest.mark.parametrize("name", CODE)
def test_code_in_a_case_is_refused(name: str, place: str, case: Path) -> None:
    path = case / place
    path.write_text(f"{path.read_text()}\n{CODE[name]}\n")
    with pytest.raises(SceneError, match=rf"air.case: {place} has .*; a case is read and never run"):
        find_case(str(case), case)


CALC = '#calc "1 + system(1)";'
HIDDEN = {  # what is added to a file of the case, or makes one: each of these passed the search before this one
    "// in a string": {"system/controlDict": f'a "//"; x {CALC}'},
    "/* in a string": {"system/controlDict": f'a "/*"; x {CALC} b "*/";'},
    "// in a path": {"system/controlDict": 'libs ("//tmp/evil.so");'},
    "// behind a variable": {"system/controlDict": f"a 1; b $a// ; x {CALC}"},  # 1912 reads $a//
    "// in a variable": {"system/controlDict": f"a 1; b ${{a}}// ; x {CALC}"},
    "a comment that #if ends": {"system/controlDict": f"#if 1; /*\nx {CALC}\n#endif\n*/"},
    "a directive in a string": {"system/controlDict": '"#includeEtc" "caseDicts/x"'},
    "a directive unknown here": {"system/controlDict": "#compile x"},
    "sinclude": {"system/controlDict": '#sinclude "/tmp/evil"'},
    "include without a blank": {"system/controlDict": '#include"/tmp/evil"'},
    "include without #": {"system/controlDict": 'include "/tmp/evil"'},
    "include from where it is started": {"system/controlDict": '#include "./../inside"'},
    "variable behind ./": {"system/controlDict": '#include "./$up/evil"'},
    "variable in a name": {"system/controlDict": '#include "x$up/evil"'},
    "blank in a name": {"system/controlDict": '#include "a b/../../../evil"'},
    "variable of two files": {"system/parameters": "up ok;", "system/controlDict": 'up /x; #include "$up/x"'},
    "variable with two values": {"0/U": 'stepping "../../..";'},
    "variable by a pattern": {"0/U": '"st.*" "/tmp";'},
    "function of a path": {"system/controlDict": 'functions { #includeFunc "../../evil" }'},
    "include of a file beside": {"system/controlDict": '#include "../extra/f"', "extra/f": f"x {CALC}"},
    "include of one packed": {"system/controlDict": '#include "../extra/f"', "extra/f.gz": f"x {CALC}"},
    "include of a log": {"system/controlDict": '#include "../log.x"', "log.x": f"x {CALC}"},
    "libs with a number": {"system/controlDict": 'libs 1 ("/evil.so");'},
    "libs in braces": {"system/controlDict": 'libs 1{"/evil.so"};'},
    "libs of a variable": {"system/controlDict": "libs $x;", "system/forces": 'x ("/evil.so");'},
    "libs as a string": {"system/controlDict": '"libs" ("/evil.so");'},
    "libs behind a bracket": {"system/controlDict": 'libs ("x)" "/evil.so");'},
    "libs by a pattern": {"system/controlDict": '"l.*bs" ("/evil.so");'},
    "libs by a class": {"system/controlDict": '"[[:alpha:]]ibs" ("/evil.so");'},
    "libs by an escape": {"system/controlDict": '"[l\\]i[b]s" ("/evil.so");'},
    "libs of the motion": {"constant/dynamicMeshDict": 'motionSolverLibs ("/evil.so");'},
    "a condition in a string": {"500/U": 'x { type "codedFixedValue"; code "system(1);"; }'},
    "code without #{": {"500/U": 'x { code "system(1);"; }'},
    "a condition by a variable": {"system/parameters": "k codedFixedValue;", "500/U": "x { type $k; }"},
    "a coded source": {"constant/fvOptions": "x { type vectorCodedSource; }"},
    "the first time": {"0/U": f"x {CALC}"},
    "another time": {"0.25/U": f"x {CALC}"},
    "a part of a rank": {"processor0/500/U": f"x {CALC}"},
    "a region": {"0.orig/U": HEADER.format(name="U") + f"x {CALC}"},
    "the middle of a file": {"500/U": "" + "1 " * 800_000 + f"; x {CALC}" + "1 " * 800_000},
    "binary in a comment": {"system/controlDict": f"// format binary;\n// 300(\nx {CALC}" + 400 * " )"},
    "a list that is not binary": {"500/x": f"x List<scalar> 9 (1 2); y {CALC} // format binary; {60 * ')'}"},
}
SEEN = {  # what the search before this one refused too
    "a quote in a comment": {"system/controlDict": f'// "\nx {CALC} // "'},
    "a string that #if ends": {"system/controlDict": f'#if 1; "\nx {CALC}\n#endif\ny ";'},
    "a comment in a directive": {"system/controlDict": "x #/* */ calc 1;"},
    "include of a word": {"system/controlDict": "#include $evil"},
    "variable in capitals": {"system/controlDict": "D ok;", "constant/transportProperties": '#include "$D/evil"'},
}


def add(case: Path, texts: dict[str, str]) -> None:
    for name, text in texts.items():
        path = case / name
        path.parent.mkdir(parents=True, exist_ok=True)
        before = path.read_bytes() if path.exists() else b""
        path.write_bytes(before + (gzip.compress(text.encode()) if path.suffix == ".gz" else b"\n" + text.encode()))


@pytest.mark.parametrize("name", HIDDEN | SEEN)
def test_code_that_hides_is_refused(name: str, case: Path) -> None:
    add(case, (HIDDEN | SEEN)[name])
    with pytest.raises(SceneError, match=r"air.case: .* has .*; a case is read and never run"):
        find_case(str(case), case)


@pytest.mark.parametrize("place", ["system", "constant"])
def test_folders_that_are_linked_are_searched(place: str, case: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "fvOptions").write_text(CODE["coded function"])
    (case / place / "more").symlink_to(tmp_path / "elsewhere")
    (case / "again").symlink_to(case)  # in a circle
    with pytest.raises(SceneError, match=f"air.case: {place}/more/fvOptions has a coded condition"):
        find_case(str(case), case)


def test_one_file_is_asked_for_again_when_it_has_changed(case: Path) -> None:
    refuse_code(case)
    add(case, {"0/U": CODE["#calc"]})
    with pytest.raises(SceneError, match="0/U has #calc"):
        refuse_code(case)


HARMLESS = {
    "a comment": {"system/controlDict": f"// x {CALC}\n/* y {CALC} // */ /* libs (\"/x\"); **/"},
    "libraries": {"system/controlDict": 'libs ("libforces.so" "libfieldFunctionObjects.so"); x { libs (forces); }'},
    "every key": {"system/fvSolution": 'relaxationFactors { fields { ".*" 0.7; } } solvers { ".*" { solver PCG; } }'},
    "any scheme": {"system/fvSchemes": 'divSchemes { ".*" Gauss linear; default none; }'},
    "names of patches": {"0/p": 'x { "(left|right)_wall.*" { type slip; } "code and more" { type slip; } '
                         '"body_[0-9]+" { type slip; } calibs { type slip; } }'},
    "an include beside": {"system/controlDict": '#include "../extra/f"', "extra/f": "a 1;"},
    "a function of the case": {"system/controlDict": "functions { #includeFunc residuals\n}"},
    "paths of data": {"system/sampleDict": 'surfaces ("$FOAM_CASE/constant/a.stl" "../b/c.stl"); file "/tmp/x";'},
    "scripts": {"Allrun": "#!/bin/sh\n# Run from this directory: code\nsimpleFoam", "README.md": "# the code"},
    "a log": {"log.simpleFoam": f"x {CALC}", "postProcessing/forces/0/x.dat": "# Time Cd\n0 1"},
    "a surface": {"constant/triSurface/body.obj": "# Wavefront OBJ file\nv 1 2 3"},
    "a condition": {"system/controlDict": "#if $ok // or not\na 1;\n#else\na 2;\n#endif\n#remove a\n"},
    "what an interruption left": {"500/x": BINARY + "v List<scalar> 99\n(\"#calc"},
    "half a string": {"500/uniform/time": 'FoamFile { version 2.0; format ascii; location "500/uni'},
}  # fmt: skip


@pytest.mark.parametrize("name", HARMLESS)
def test_what_a_case_may_hold_passes(name: str, case: Path) -> None:
    add(case, HARMLESS[name])
    assert find_case(str(case), case) == case


FIELD = (
    'FoamFile {{ version 2.0; format {form}; class {kind}; {more} location "500"; object x; }}\n// * * *\n'
    "dimensions [0 1 -1 0 0 0 0];\ninternalField nonuniform {what} "
)
BYTES = {
    "vectors": (FIELD, "volVectorField", "", "List<vector>", 24),
    "scalars": (FIELD, "volScalarField", 'arch "LSB;label=32;scalar=64";', "List<scalar>", 8),
    "single precision": (FIELD, "volScalarField", 'arch "LSB;label=32;scalar=32";', "List<scalar>", 4),
    "tensors": (FIELD, "volTensorField", "", "List<tensor>", 72),
    "symmetric": (FIELD, "volSymmTensorField", "", "List<symmTensor>", 48),
}


@pytest.mark.parametrize("name", BYTES)
def test_bytes_that_look_like_code_by_chance_are_none(name: str, case: Path) -> None:
    """Numbers in bytes, with text in them; and what is behind them is read."""
    head, kind, more, what, width = BYTES[name]
    numbers = (b'"#calc\\ #{ " /* codedX; libs (/x) ' * 99)[: 30 * width]
    begin = head.format(form="binary", kind=kind, more=more, what=what).encode() + b"\n30\n(" + numbers
    (case / "500" / "x").write_bytes(begin + b");\nboundaryField { inlet { type slip; } }\n")
    refuse_code(case)
    (case / "500" / "x").write_bytes(begin + b");\nboundaryField { inlet { type coded; } }\n")
    with pytest.raises(SceneError, match="500/x has a coded condition"):
        refuse_code(case)
    (case / "500" / "x").rename(case / "system" / "x")  # where no field is
    with pytest.raises(SceneError, match="system/x has a list of bytes"):
        refuse_code(case)


@pytest.mark.parametrize(("kind", "width"), [("vectorField", 24), ("labelList", 4), ("faceCompactList", 4)])
def test_bytes_of_a_mesh_are_no_code(kind: str, width: int, case: Path) -> None:
    header = f"FoamFile {{ version 2.0; format binary; class {kind}; object points; }}\n// * * *\n".encode()
    one = b"\n20\n(" + (b'#calc " #{' * 99)[: 20 * width] + b")"
    (case / "constant" / "polyMesh" / "points").write_bytes(header + one * (2 if kind == "faceCompactList" else 1))
    refuse_code(case)


def test_a_binary_list_hides_nothing_from_who_reads_it_as_text(case: Path) -> None:
    """Included, a file is read as text whatever its header says."""
    text = BINARY + "x List<scalar> 4 (1 2 3 4); y #calc 1;     );"
    add(case, {"500/x": text, "system/controlDict": '#include "../500/x"'})
    with pytest.raises(SceneError, match="500/x has a list of bytes"):
        refuse_code(case)


LONG = {
    "libs": "libs(" * 200_000,
    "quotes": '"' * 400_001,
    "comments": "/*" * 400_000,
    "variables": "$(" * 200_000,
    "letters": "e" * 1_000_000,
    "patterns": '"(a|b)*" "[l]+(i|.)b.*s" ' * 40_000,
    "conditions": "#if " * 100_000,
    "lists": "x List<scalar> " * 70_000,
}


@pytest.mark.parametrize("name", LONG)
def test_the_search_takes_no_longer_than_the_file_is_long(name: str, case: Path) -> None:
    add(
        case, {"500/x": HEADER.format(name="x").replace("ascii", "binary" if name == "lists" else "ascii") + LONG[name]}
    )
    began = time.process_time()
    with suppress(SceneError):
        refuse_code(case)
    assert time.process_time() - began < 2.0


def test_a_large_field_costs_next_to_nothing(case: Path) -> None:
    begin = FIELD.format(form="ascii", kind="volVectorField", more="", what="List<vector>")
    row = "(1.25e-05 -0.33333 0)\n"
    add(case, {"500/x": f'{begin}\n900000\n(\n{row * 900_000})\n;\nboundaryField {{ "in.*" {{ type slip; }} }}'})
    began = time.process_time()
    refuse_code(case)
    assert time.process_time() - began < 1.0
    began = time.process_time()
    refuse_code(case)  # remembered
    assert time.process_time() - began < 0.1


# -- A case in a cache that may come from others -----------------------------------------------------------------------
@pytest.fixture
def prepared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], object]:
    """Prepare the case in a folder; OpenFOAM does not start."""
    monkeypatch.setattr("wakeflow.foam.prepare.call", lambda *words: pytest.fail(f"started {words}"))
    mesh = plan_mesh([RHOMBUS], width=5 * WIDTH, top=3 * WIDTH, bottom=-6 * WIDTH, rung="draft", scale=2.0)
    spec = FlowSpec(mesh, 1.0, 1.2, 1.2 * WIDTH / 20, turbulence="laminar")
    write_case(spec, tmp_path / "key.part" / "case")
    save(tmp_path / "key.part" / "case" / CHECKED, CheckMesh(1.0, 1.0, 1.0))
    return lambda folder: prepare_case(spec, tmp_path / "mesh.msh", folder)


FOREIGN = {
    "constant/fvOptions": 'libs ("/x/evil.so");',
    "500/U": "inlet { type codedFixedValue; }",
    "span/constant/fvOptions": "x { type vectorCodedSource; }",
    "system/more": "functions { f { type systemCall; } }",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_case_in_the_cache_that_holds_code_is_not_gone_on_from(
    name: str, prepared: Callable[[Path], object], tmp_path: Path
) -> None:
    case = tmp_path / "key.part" / "case"
    prepared(case)  # as it is
    add(case, {name: HEADER.format(name="x") + FOREIGN[name]})
    with pytest.raises(SceneError, match=rf"case: {name} has .*; this program did not write that: remove the folder"):
        prepared(case)
    with pytest.raises(SceneError, match=f"case: {name} has"):
        start_from(None, tmp_path, case)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["", "case", "case/constant", "case/system/controlDict", "case/0/k"])
def test_a_case_in_the_cache_with_a_link_is_not_gone_on_from(
    name: str, prepared: Callable[[Path], object], tmp_path: Path
) -> None:
    """What is written there would be written elsewhere."""
    path, away = tmp_path / "key.part" / name, tmp_path / "elsewhere"
    path.rename(away)
    before = {one: one.stat().st_mtime_ns for one in away.rglob("*")}
    path.symlink_to(away)
    with pytest.raises(SceneError, match=f"{path.name} is a link that leads elsewhere; this program did not write"):
        prepared(tmp_path / "key.part" / "case")
    assert {one: one.stat().st_mtime_ns for one in away.rglob("*")} == before


class Bomb:
    """Makes a folder where it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.folder),)


def test_the_index_of_kernels_in_a_cache_is_not_read(tmp_path: Path) -> None:
    """A folder of results that comes with a cache, runs/.cache, as it was before: with kernels that are pickles."""
    from wakeflow.core.sources import code_key

    for module, kernel in (("wakeflow.tracking.kernel.loop", "loop.fly_block"), ("wakeflow.tracking", "x")):
        folder = tmp_path / "runs" / ".cache" / "numba" / code_key(module)[:20]
        for place in (folder, folder / "kernel_0"):
            place.mkdir(parents=True)
            (place / f"{kernel}-268.py311.nbi").write_bytes(
                pickle.dumps("0.68.1") + pickle.dumps(Bomb(tmp_path / "ran"))
            )
    code = (
        "import numpy as np; from wakeflow.tracking import Granules, track\n"
        "track(None, Granules(np.zeros((1, 2)), np.ones((1, 2)), diameter=1e-3, density=1.0), until=1.0)"
    )
    environment = {key: value for key, value in os.environ.items() if key != "WAKEFLOW_CACHE"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    assert not (tmp_path / "ran").exists()
    assert not kernel_root().is_relative_to(tmp_path)


ROOT_OF_KERNELS = "from wakeflow.core.sources import kernel_root; print(kernel_root())"


def where(**environment: str) -> Path:
    base = {
        key: value for key, value in os.environ.items() if key not in ("WAKEFLOW_KERNELS", "XDG_CACHE_HOME", "HOME")
    }
    done = subprocess.run(
        [sys.executable, "-c", ROOT_OF_KERNELS], env=base | environment, capture_output=True, text=True, check=True
    )
    return Path(done.stdout.strip())


def test_kernels_live_in_the_users_own_cache_and_where_others_may_write_none_is_believed(tmp_path: Path) -> None:
    assert where(HOME=str(tmp_path)) == tmp_path / ".cache" / "wakeflow" / "kernels"
    assert where(XDG_CACHE_HOME=str(tmp_path / "x")) == tmp_path / "x" / "wakeflow" / "kernels"
    assert where(HOME=str(tmp_path), WAKEFLOW_KERNELS=str(tmp_path / "asked")) == tmp_path / "asked"
    (tmp_path / ".cache" / "wakeflow" / "kernels").chmod(0o777)
    found = where(HOME=str(tmp_path))
    assert found.name.startswith("wakeflow-kernels-")
    assert not found.exists()  # it ended with its process
