"""Python and the command line make the same run."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import hksl
import pytest

STEPS = "step-000000480/weights.safetensors"


def without_time(folder):
    with open(folder / "eval.csv", newline="") as file:
        return [{key: value for key, value in row.items() if key != "wall_seconds"} for row in csv.DictReader(file)]


def commands():
    """The command of this package and, in a checkout where it is built, the binary."""
    yield [str(Path(sys.executable).with_name("hksl"))]
    binary = Path(__file__).resolve().parents[3] / "target/release/hksl"
    if binary.is_file() and shutil.which(binary):
        yield [str(binary)]


@pytest.mark.parametrize("task", ["falling-pixels", "cartpole-swingup"])
def test_python_and_the_command_line_give_the_same_bits(runs, task):
    training = hksl.train(
        task, preset="debug", seed=5, config={"sac.batch_size": 6}, runs=runs / "python", progress=False
    )
    for number, command in enumerate(commands()):
        place = runs / str(number)
        arguments = ["train", task, "--preset", "debug", "--seed", "5", "--set", "sac.batch_size=6"]
        subprocess.run([*command, *arguments, "--runs", place, "--quiet"], check=True)
        folder = place / training.folder.relative_to(runs / "python")
        for file in ("config.toml", f"checkpoints/{STEPS}"):
            assert (folder / file).read_bytes() == (training.folder / file).read_bytes(), (command, file)
        assert without_time(folder) == without_time(training.folder)


def test_python_opens_a_run_of_the_command_line_and_resumes_it(runs):
    command = next(commands())
    arguments = ["train", "falling-pixels", "--preset", "debug", "--runs", runs, "--quiet"]
    subprocess.run([*command, *arguments], check=True)
    folder = runs / "falling-pixels/hksl-debug/seed-1"
    assert hksl.load(folder, checkpoint=240).environment_step == 240
    longer = hksl.train("falling-pixels", preset="debug", runs=runs, environment_steps=720, progress=False)
    assert longer.folder == folder and longer.environment_step == 720
