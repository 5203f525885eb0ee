"""Every command of README, docs and ``--help`` is taken: it goes as far as its first computation, which is left out."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pages import PAGES, commands_in, shell_lines, spans
from support import CASES
from wakeflow.cli import app, main
from wakeflow.core.files import scene_templates

FINISHED = "reads a finished run of minutes: test_tutorial.py, show and many of tests/unit run it on small ones"
LEFT_OUT = {  # the first words of a command, and why it is not tried here
    "animate": FINISHED, "bins": FINISHED, "compare": FINISHED, "view": FINISHED, "report": FINISHED,
    "sensitivity runs/": FINISHED, "run cases/rhombus.toml --set air.speed=5.5 --near runs/rhombus": FINISHED,
    "verify": "minutes to hours: tests/proofs proves each problem, --slow the long ones",
    "doctor": "tries programs: tests/unit/cli/test_doctor.py",
    "--install-completion": "tests/unit/cli/test_cli.py installs it for every shell",
    "sweep cases/sweep-air-speed.toml --scheduler": "asks for a cluster: tests/unit/many/test_on_a_cluster.py",
}  # fmt: skip
STANDS_FOR = {"SCENE": "cases/funnel.toml", "NAME": "wheat", "FILE": "mine.toml"}
EXAMPLE = re.compile(r"[a-z][\w.*-]*=(?:'[^']*'|[^\s;:)']*[^\s,.;:)'])|'\d[^']*'|\d[\d.]*(?:%|GB)")
OF_OPTIONS = {  # what an option's example is tried with
    "bins": FINISHED, "animate": FINISHED, "view": FINISHED, "clean": "clean --dry-run",
    "search": "search cases/search-splitters.toml", "calibrate": "calibrate cases/rhombus.toml trays.csv",
    "sweep": "sweep cases/rhombus.toml", "sensitivity": "sensitivity cases/rhombus.toml",
    "map": "map cases/aspirator.toml", "capacity": "capacity cases/aspirator.toml",
    "run": "run cases/rhombus.toml", "plan": "plan cases/rhombus.toml", "protocol": "protocol cases/rhombus.toml",
}  # fmt: skip


class _Begins(BaseException):
    """What comes now would be computed."""


def _of_pages() -> Iterator[str]:
    for command in sorted(
        {one for page in PAGES for one in commands_in((*shell_lines(page), *spans(page.read_text())))}
    ):
        whole = any(not word.startswith("-") for word in shlex.split(command)[1:])  # not an option that prose names
        if whole and not any(command.startswith(start) for start in LEFT_OUT):
            yield command


def _of_options() -> Iterator[str]:
    """Each option with each example that its help has, of the first command that has them."""
    seen = set()
    for name in app:
        for one in [] if name.startswith("-") else app[name].assemble_argument_collection():
            for example in EXAMPLE.findall(one.parameter.help or ""):
                if OF_OPTIONS[name] is not FINISHED and (one.parameter.help, example) not in seen:
                    seen.add((one.parameter.help, example))
                    yield f"{OF_OPTIONS[name]} {one.name} {example}"


def _begin(*_: object, **__: object) -> Any:
    raise _Begins


@pytest.mark.parametrize("command", dict.fromkeys([*_of_pages(), *_of_options()]))
def test_a_command_that_is_shown_is_taken(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for start in ("core.store.Store.make", "many.compute.executor_on", "extras.search.designs.executor_on"):
        monkeypatch.setattr(f"wakeflow.{start}", _begin)
    monkeypatch.setattr("wakeflow.extras.page.server.Page.listen", _begin)
    monkeypatch.setattr("wakeflow.flight.stages.compilation.Compilation.begin", lambda *_, **__: None)
    monkeypatch.setattr("wakeflow.planning.uniform_fall._landing_shift", lambda *_: 0.0)  # most of a plan's time
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cases").symlink_to(CASES)
    (tmp_path / "trays.csv").write_text("fraction,bin,share,uncertainty\nwheat,middle,0.1,0.02\n")
    (tmp_path / "trial.csv").write_text((CASES / "trial" / "trial.csv").read_text().replace(",\n", ",3\n"))
    if not command.startswith("new "):
        (tmp_path / "my.toml").write_text(scene_templates()["rhombus"].read_text())
    try:
        code = main([STANDS_FOR.get(word, word) for word in shlex.split(command)])
    except _Begins:
        code = 0
    assert code == 0, capsys.readouterr().err


def test_what_is_not_tried_is_shown() -> None:
    """A reason is given for what there is."""
    shown = [one for page in PAGES for one in commands_in((*shell_lines(page), *spans(page.read_text())))]
    assert [start for start in LEFT_OUT if not any(one.startswith(start) for one in shown)] == []
