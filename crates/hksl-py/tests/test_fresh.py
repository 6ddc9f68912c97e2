"""The wheel in a virtual environment of its own, in an empty folder, without the checkout."""

import re
import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[3]


def test_the_readmes_lines_run_in_a_fresh_environment(tmp_path):
    wheels = sorted((CHECKOUT / "target" / "wheels").glob("hksl-*.whl"), key=lambda path: path.stat().st_mtime)
    assert wheels, "no wheel; run `make wheel`"
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv/bin/python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", wheels[-1]], check=True)
    blocks = re.findall(r"```python\n(.*?)```", (CHECKOUT / "README.md").read_text(), re.DOTALL)
    assert blocks
    native = (
        "\nimport hksl\npackage = __import__('pathlib').Path(hksl.__file__).parent\n"
        "loaded = open('/proc/self/maps').read()\n"
        "assert str(package / 'native' / 'libmujoco.so') in loaded, 'another libmujoco'\n"
    )
    (tmp_path / "empty").mkdir()
    subprocess.run([python, "-c", "\n".join(blocks) + native], cwd=tmp_path / "empty", check=True)
    subprocess.run([tmp_path / "venv/bin/hksl", "doctor"], cwd=tmp_path / "empty", check=True)
