"""Set-up on a fresh checkout: a second start waits for the first and repeats nothing of it; a killed one is mended."""

import os
import shutil
import signal
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
  "-m pip --version") [ -e "{log}.cut" ] && {{ rm "{log}.cut"; exit 1; }}; exit 0 ;;
  *"pip install"*) echo "begin pip" >>"{log}"; sleep 1; echo "end pip" >>"{log}" ;;
esac
"""


def checkout(cases: Path, folder: Path, **more: str) -> tuple[list[str], dict[str, str]]:
    """The command that sets a fresh checkout up, and its environment: tools that stand for others, and ``more``."""
    root, tools, log = folder / "checkout", folder / "tools", folder / "log"
    (root / "cases").mkdir(parents=True)
    shutil.copy(cases / "setup.sh", root / "cases")
    (root / "pyproject.toml").write_text("")
    (root / "requirements.lock").write_text("")
    tools.mkdir()
    texts = {"dpkg-query": "#!/bin/sh\necho 'install ok installed'\n", "py": PYTHON.format(log=log)} | more
    for name, text in texts.items():
        (tools / name).write_text(text)
        (tools / name).chmod(0o755)
    environment = os.environ | {"PATH": f"{tools}:{os.environ['PATH']}", "PYTHON": str(tools / "py")}
    return ["sh", str(root / "cases" / "setup.sh")], environment


@pytest.mark.skipif(shutil.which("flock") is None, reason="needs flock")
def test_a_second_set_up_waits_for_the_first(cases: Path, tmp_path: Path) -> None:
    command, environment = checkout(cases, tmp_path)
    log = tmp_path / "log"
    both = [subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [one.communicate(timeout=300)[1] for one in both]
    assert [one.returncode for one in both] == [0, 0], said
    assert log.read_text().split("\n")[:-1] == ["begin venv", "end venv", "begin pip", "end pip"]
    assert sum("another set-up is at work here; waiting for it" in one for one in said) == 1


def test_a_python_without_pip_that_a_killed_set_up_left_is_made_anew(cases: Path, tmp_path: Path) -> None:
    command, environment = checkout(cases, tmp_path)
    for _ in range(2):
        subprocess.run(command, env=environment, check=True, timeout=300)
    (tmp_path / "log.cut").touch()
    subprocess.run(command, env=environment, check=True, timeout=300)
    once = ["begin venv", "end venv", "begin pip", "end pip"]
    assert (tmp_path / "log").read_text().split("\n")[:-1] == [*once, *once]


APT = """#!/bin/sh
# stands for apt-get with a package that starts a daemon
[ "$1" = update ] || { sleep 300 & echo $! >"$0.daemon"; }
"""


@pytest.mark.skipif(shutil.which("flock") is None, reason="needs flock")
def test_a_daemon_that_a_package_starts_does_not_keep_the_lock(cases: Path, tmp_path: Path) -> None:
    nothing, root = "#!/bin/sh\nexit 1\n", "#!/bin/sh\necho 0\n"
    command, environment = checkout(cases, tmp_path, **{"dpkg-query": nothing, "id": root, "apt-get": APT})
    subprocess.run(command, env=environment, check=True, timeout=300)
    daemon = int((tmp_path / "tools" / "apt-get.daemon").read_text())
    try:
        lock = tmp_path / "checkout" / ".setup.lock"
        assert subprocess.run(["flock", "-n", str(lock), "true"], check=False).returncode == 0
    finally:
        os.kill(daemon, signal.SIGKILL)
