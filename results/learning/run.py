#!/usr/bin/env python3
"""Runs the experiments on what HKSL learns, one after the other, and collects their numbers here.

Run it again at any time: what is done is skipped, what was cut goes on. Needs Python alone.

    python3 results/learning/run.py --hksl target/release/hksl --runs /somewhere/with/30/GB
"""

import argparse
import json
import pathlib
import shutil
import signal
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent

# name: task, and what differs from the defaults. In the order in which they are wanted.
EXPERIMENTS = {
    "cartpole": ["cartpole-swingup"],
    "cartpole-no-repr": ["cartpole-swingup", "--ablation", "no-repr"],
    "cartpole-joint": ["cartpole-swingup", "--set", "hksl.update_schedule=joint", "--name", "joint",
                       "--environment-steps", "50000"],
    "falling-pixels": ["falling-pixels", "--environment-steps", "60000"],
    "falling-pixels-no-repr": ["falling-pixels", "--ablation", "no-repr", "--environment-steps", "60000"],
    "falling-pixels-pad-0": ["falling-pixels", "--set", "augmentation.pad=0", "--name", "pad-0",
                             "--environment-steps", "60000"],
}
# Of metrics.jsonl, lines at multiples of this many agent steps are kept: those that a diagnosis ends up in.
KEEP_EVERY = 500


def folder(arguments, runs, hksl):
    """The run's folder, as hksl itself names it."""
    shown = subprocess.run([hksl, "train", *arguments, "--runs", runs, "--dry-run"],
                           capture_output=True, text=True, check=True).stdout
    line = next(line for line in shown.splitlines() if line.split()[:1] == ["folder"])
    return pathlib.Path(line.split(maxsplit=1)[1])


def collect(name, run):
    """Copies what is kept of a run: evaluations, thinned metrics, what it ran on and by which commands."""
    target = HERE / "data" / name
    target.mkdir(parents=True, exist_ok=True)
    for file in ["eval.csv", "environment.json", "command.txt"]:
        if (run / file).is_file():
            shutil.copy(run / file, target / file)
    if (run / "metrics.jsonl").is_file():
        lines = (run / "metrics.jsonl").read_text().splitlines()
        kept = [line for line in lines if json.loads(line)["agent_step"] % KEEP_EVERY == 0]
        (target / "metrics.jsonl").write_text("".join(line + "\n" for line in kept))


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("names", nargs="*", help=f"experiments, all by default: {', '.join(EXPERIMENTS)}")
    options.add_argument("--hksl", default="target/release/hksl", help="the binary")
    options.add_argument("--runs", default="runs", help="where the runs are kept")
    options.add_argument("--threads", default="0", help="CPU threads")
    options = options.parse_args()
    for name in options.names or EXPERIMENTS:
        if name not in EXPERIMENTS:
            sys.exit(f"unknown experiment {name}; there are {', '.join(EXPERIMENTS)}")
        arguments = [*EXPERIMENTS[name], "--threads", options.threads]
        run = folder(arguments, options.runs, options.hksl)
        print(f"{name}: {run}", flush=True)
        # A session of its own: Ctrl-C then reaches it once, through here.
        process = subprocess.Popen([options.hksl, "train", *arguments, "--runs", options.runs],
                                   start_new_session=True)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
            signal.signal(number, lambda number, _: process.send_signal(number))
        code = process.wait()
        collect(name, run)
        if code != 0:
            sys.exit(code)


if __name__ == "__main__":
    main()
