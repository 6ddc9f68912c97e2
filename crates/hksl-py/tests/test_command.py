"""The command `hksl` of the package."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import hksl
import pytest

COMMAND = str(Path(sys.executable).with_name("hksl"))


def run(*arguments, **options):
    return subprocess.run(arguments, capture_output=True, text=True, **options)


@pytest.mark.parametrize("command", [(COMMAND,), (sys.executable, "-m", "hksl")])
def test_it_is_the_command_line(command, tmp_path):
    version = run(*command, "--version", cwd=tmp_path)
    assert (version.returncode, version.stdout) == (0, f"hksl {hksl.__version__}\n")
    tasks = run(*command, "tasks", "--quiet", cwd=tmp_path).stdout
    assert all(task in tasks for task in hksl.tasks())
    wrong = run(*command, "train", "chess", cwd=tmp_path)
    assert wrong.returncode == 2 and "unknown task `chess`" in wrong.stderr
    assert run(*command, "config", "show", "cartpole-swingup", cwd=tmp_path).returncode == 0


def test_ctrl_c_saves_and_the_same_command_resumes(tmp_path):
    arguments = [COMMAND, "train", "falling-pixels", "--preset", "debug", "--environment-steps", "11520"]
    process = subprocess.Popen(arguments, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    metrics = tmp_path / "runs/falling-pixels/hksl-debug/seed-1/metrics.jsonl"
    end = time.monotonic() + 60
    while not (metrics.is_file() and metrics.stat().st_size > 0) and time.monotonic() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 75
    assert (tmp_path / "runs/falling-pixels/hksl-debug/seed-1/command.txt").read_text().startswith("hksl train")
    assert run(*arguments, cwd=tmp_path).returncode == 0


def test_a_sweep_starts_its_runs_with_it(tmp_path):
    study = (
        'name = "two"\npresets = ["debug"]\n\n'
        '[[group]]\ntasks = ["falling-pixels"]\nmethods = ["sac"]\nseeds = [1, 2]\n'
    )
    (tmp_path / "two.toml").write_text(study)
    swept = run(COMMAND, "sweep", "two.toml", cwd=tmp_path)
    assert swept.returncode == 0, swept.stderr
    assert len(list(tmp_path.glob("**/done"))) == 2
