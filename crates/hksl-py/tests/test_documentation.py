"""What the book shows runs, and what the package says of itself is complete."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import hksl
import pytest

CHECKOUT = Path(__file__).resolve().parents[3]
PAGE = CHECKOUT / "docs" / "python.md"


def test_the_pages_code_runs_in_order(tmp_path, monkeypatch):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(blocks) == 6
    code = "\n".join(blocks)
    # A run of hours becomes one of seconds; the folder's name has no preset then.
    long = 'environment_steps=100_000, config={"sac.batch_size": 64}'
    assert long in code
    short = 'environment_steps=480, preset="debug", name="", config={"environment.episode_steps": 80}'
    code = code.replace(long, short.replace('name="", ', "")).replace(
        "Pendulum-v1/hksl/", "Pendulum-v1/hksl-debug/"
    )
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(PAGE), "exec"), {"__name__": "page"})
    assert (tmp_path / "policy.safetensors").is_file() and (tmp_path / "agent").is_dir()


@pytest.mark.parametrize("example", ["train_your_task.py", "probe_your_task.py"])
def test_the_examples_run(tmp_path, example):
    script = CHECKOUT / "crates" / "hksl-py" / "examples" / example
    subprocess.run([sys.executable, script, "--quick"], cwd=tmp_path, check=True)


def test_everything_public_is_documented():
    assert hksl.__doc__ and set(hksl.__all__) <= set(dir(hksl))
    for name in hksl.__all__:
        thing = getattr(hksl, name)
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for method, of in vars(thing).items():
                if not method.startswith("_") and (callable(of) or isinstance(of, property)):
                    assert inspect.getdoc(of), f"{name}.{method}"


def test_the_types_hold(tmp_path):
    script = tmp_path / "client.py"
    script.write_text(
        "import hksl\n"
        "import numpy as np\n"
        'policy: hksl.Policy = hksl.load("run", checkpoint=3)\n'
        "action: np.ndarray = policy.act(np.zeros((3, 43, 23), np.uint8))\n"
        'training = hksl.train("falling-pixels", preset="debug")\n'
        "steps: int = training.environment_step\n"
    )
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache")]
    # The sources, and a client of what is installed.
    for place, target in [(CHECKOUT / "crates/hksl-py/python", "hksl"), (tmp_path, "client.py")]:
        checked = subprocess.run([*command, target], capture_output=True, text=True, cwd=place)
        assert checked.returncode == 0, checked.stdout + checked.stderr
