"""Two starts of cases/run.sh on a fresh checkout: the second waits for the first and repeats nothing of it."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

PYTHON = """#!/bin/sh
# stands for the system's python, and for that of .venv: notes what it is asked for, and takes its time
case "$*" in
  *sys.version_info*) exit 0 ;;
  "-m venv "*)
    echo "begin venv" >>"{log}"
    mkdir -p "$3/bin"
    cp "$0" "$3/bin/python"
    sleep 1
    echo "end venv" >>"{log}"
    ;;
  *"pip install"*) echo "begin pip" >>"{log}"; sleep 1; echo "end pip" >>"{log}" ;;
esac
"""


@pytest.mark.skipif(shutil.which("flock") is None, reason="needs flock")
def test_a_second_set_up_waits_for_the_first(cases: Path, tmp_path: Path) -> None:
    root, log = tmp_path / "checkout", tmp_path / "log"
    (root / "cases").mkdir(parents=True)
    shutil.copy(cases / "setup.sh", root / "cases")
    (root / "pyproject.toml").write_text("")
    (root / "requirements.lock").write_text("")
    tools = tmp_path / "tools"
    tools.mkdir()
    for name, text in {"dpkg-query": "#!/bin/sh\necho 'install ok installed'\n", "py": PYTHON.format(log=log)}.items():
        (tools / name).write_text(text)
        (tools / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{tools}:{os.environ['PATH']}", "PYTHON": str(tools / "py")}
    command = ["sh", str(root / "cases" / "setup.sh")]
    both = [subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [one.communicate(timeout=300)[1] for one in both]
    assert [one.returncode for one in both] == [0, 0], said
    assert log.read_text().split("\n")[:-1] == ["begin venv", "end venv", "begin pip", "end pip"]
    assert sum("another set-up is at work here; waiting for it" in one for one in said) == 1
