#!/usr/bin/env python3
"""Runs the experiments on what HKSL learns, one after the other, collects their numbers here and draws them.

Run it again at any time: finished runs are skipped, stopped ones resume. Needs Python, and cargo for the pictures.

    python3 results/learning/run.py --hksl target/release/hksl --runs /somewhere/with/30/GB
    python3 results/learning/run.py falling-pixels-reading ...    # the studies of Falling Pixels, by name
    python3 results/learning/run.py --collect ... --runs RUNS     # collect what there is, run nothing
    python3 results/learning/run.py --draw    # only pictures and tables, from the numbers here
"""

import argparse
import csv
import json
import pathlib
import re
import shutil
import signal
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent

# name: task, and what differs from the defaults. In the order in which they are wanted.
EXPERIMENTS = {
    "cartpole": ["cartpole-swingup"],
    "cartpole-drq": ["cartpole-swingup", "--method", "drq", "--environment-steps", "50000"],
    "cartpole-curl": ["cartpole-swingup", "--method", "curl", "--environment-steps", "50000"],
    "cartpole-no-repr": ["cartpole-swingup", "--ablation", "no-repr"],
    "cartpole-joint": ["cartpole-swingup", "--set", "hksl.update_schedule=joint", "--name", "joint",
                       "--environment-steps", "50000"],
    "falling-pixels": ["falling-pixels", "--preset", "crop", "--environment-steps", "60000"],
    "falling-pixels-no-repr": ["falling-pixels", "--preset", "crop", "--ablation", "no-repr",
                               "--environment-steps", "60000"],
    "falling-pixels-pad-0": ["falling-pixels", "--preset", "crop", "--set", "augmentation.pad=0", "--name", "pad-0",
                             "--environment-steps", "60000"],
    "falling-pixels-canvas-drq": ["falling-pixels", "--method", "drq", "--environment-steps", "30000"],
    "falling-pixels-canvas": ["falling-pixels", "--environment-steps", "30000"],
}
# Studies of many runs, configs/studies/NAME.toml, with the agent steps that their tables show.
STUDIES = {
    "falling-pixels-reading": [2500, 5000, 10000, 15000, 20000, 25000, 30000],
    "falling-pixels-mechanism": [2500, 5000, 7500, 10000, 12500, 15000, 17500, 20000],
    "falling-pixels-comparison": [5000, 10000, 20000, 30000, 40000],
}
# file: title, axis, experiments, levels to compare with (their sources are in README.md).
CURVES = {
    "cartpole-swingup": ("cartpole-swingup, seed 1",
                         ["cartpole", "cartpole-drq", "cartpole-curl", "cartpole-no-repr", "cartpole-joint"],
                         {"uniform random": 133, "CURL's paper at 100,000": 582, "DrQ's paper at 100,000": 759}),
    "falling-pixels": ("Falling Pixels, seed 1", ["falling-pixels", "falling-pixels-no-repr", "falling-pixels-pad-0"],
                       {"uniform random": 4.8, "planning": 33}),
}
# What the curves of experiments are called in the figures of all.
LABELS = {
    "cartpole": "HKSL", "cartpole-drq": "DrQ", "cartpole-curl": "CURL", "cartpole-no-repr": "HKSL no-repr",
    "cartpole-joint": "HKSL joint", "falling-pixels": "HKSL", "falling-pixels-no-repr": "HKSL no-repr",
    "falling-pixels-pad-0": "HKSL pad 0",
}
# suffix of the file: axis, and the columns of metrics.jsonl, those ending in _ once for each level.
DIAGNOSES = {
    "representation-gradients": ("norm of an encoder's gradient", ["representation_gradient_"]),
    "critic-gradients": ("norm of an encoder's gradient", ["critic_gradient_", "critic_gradient"]),
    "contrastive-gradients": ("norm of an encoder's gradient", ["contrastive_gradient"]),
    "latent-spread": ("standard deviation of the latents", ["latent_std_", "latent_std"]),
    "latent-rank": ("effective rank of the latents", ["latent_rank_", "latent_rank"]),
    "values": ("mean value less observed return", ["q_bias_", "q_bias"]),
    "entropy": ("entropy of the policy, nats", ["entropy"]),
    "saturated-actions": ("share of saturated actions", ["saturated_actions"]),
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
    for file in ["eval.csv", "environment.json"]:
        if (run / file).is_file():
            shutil.copy(run / file, target / file)
    # Not where the runs were kept, which is the machine's affair.
    commands = re.sub(r"--runs \S+", "--runs runs", (run / "command.txt").read_text())
    (target / "command.txt").write_text(commands)
    if (run / "metrics.jsonl").is_file():
        lines = (run / "metrics.jsonl").read_text().splitlines()
        kept = [line for line in lines if json.loads(line)["agent_step"] % KEEP_EVERY == 0]
        (target / "metrics.jsonl").write_text("".join(line + "\n" for line in kept))


def study_runs(name, runs, hksl):
    """The runs of a study, as paths under the folder of runs."""
    shown = subprocess.run([hksl, "sweep", ROOT / f"configs/studies/{name}.toml", "--runs", runs, "--dry-run"],
                           capture_output=True, text=True, check=True).stdout
    return [line.split()[0] for line in shown.splitlines() if re.match(r"\S+/seed-\d+ ", line)]


def collect_study(name, runs, hksl):
    for run in study_runs(name, runs, hksl):
        if (pathlib.Path(runs) / run / "eval.csv").is_file():
            collect(f"{name}/{run.partition('/')[2]}", pathlib.Path(runs) / run)


def tabulate_study(name, steps):
    """A study's table, NAME.csv: returns by agent step of every run, mean and standard deviation over seeds of every
    variant, and the last values of what the critics know of the action."""
    rows = []
    for variant in sorted({path.parent for path in (HERE / "data" / name).glob("*/seed-*")}):
        curves, spreads = [], []
        for run in sorted(variant.glob("seed-*")):
            metrics, evaluations = numbers(run.relative_to(HERE / "data"))
            curve = {int(row["agent_step"]): float(row["episode_return"]) for row in evaluations}
            last = next((line for line in reversed(metrics) if any("spread" in key for key in line)), {})
            spread = {key: last[key] for key in last if "_spread" in key}
            curves.append(curve), spreads.append(spread)
            rows.append({"variant": variant.name, "seed": run.name.removeprefix("seed-"),
                         **{step: f"{curve[step]:.1f}" for step in steps if step in curve},
                         **{key: f"{value:.3f}" for key, value in spread.items()}})
        for label, summarise in [("mean", statistics.mean), ("std", statistics.pstdev)] if len(curves) > 1 else []:
            shown = [step for step in steps if all(step in curve for curve in curves)]
            if shown:
                rows.append({"variant": variant.name, "seed": label,
                             **{step: f"{summarise(curve[step] for curve in curves):.1f}" for step in shown}})
    if rows:
        columns = ["variant", "seed", *steps, *sorted({key for row in rows for key in row if "_spread" in str(key)})]
        with open(HERE / f"{name}.csv", "w", newline="") as file:
            table = csv.DictWriter(file, columns, lineterminator="\n")
            table.writeheader()
            table.writerows(rows)


def tabulate_studies():
    for name, steps in STUDIES.items():
        tabulate_study(name, steps)


def numbers(name):
    """The kept lines of an experiment's metrics, and the rows of its evaluations."""
    lines = (HERE / "data" / name / "metrics.jsonl").read_text().splitlines()
    with open(HERE / "data" / name / "eval.csv", newline="") as file:
        return [json.loads(line) for line in lines], list(csv.DictReader(file))


def plot(file, title, axis, series):
    subprocess.run(["cargo", "run", "--release", "--quiet", "-p", "hksl-report", "--example",
                    "plot_curves", "--", HERE / file, title, axis, *series], cwd=ROOT, check=True)


def draw():
    """All pictures and summary.csv, of the experiments whose numbers are here."""
    here = [name for name in EXPERIMENTS if (HERE / "data" / name / "eval.csv").is_file()]
    for file, (title, names, anchors) in CURVES.items():
        series = [f"{LABELS.get(name, name)}={HERE}/data/{name}/eval.csv:episode_return"
                  for name in names if name in here]
        if series:
            anchors = [f"{name}={value}" for name, value in anchors.items()]
            plot(f"{file}.svg", title, "return, mean of 10 episodes", series + anchors)
    rows = []
    for name in here:
        metrics, evaluations = numbers(name)
        columns = dict.fromkeys(column for line in metrics for column in line)
        for suffix, (axis, wanted) in DIAGNOSES.items():
            shown = [column for start in wanted for column in columns
                     if column == start or (start.endswith("_") and column.startswith(start))]
            if shown:
                plot(f"{name}-{suffix}.svg", f"{name}: {suffix.replace('-', ' ')}", axis,
                     [f"{column}={HERE}/data/{name}/metrics.jsonl:{column}" for column in shown])
        speeds = [line["updates_per_second"] for line in metrics if line.get("updates_per_second")]
        last = evaluations[-1]
        rows.append({
            "experiment": name,
            "environment_steps": last["environment_step"],
            "last_return": f"{float(last['episode_return']):.1f}",
            "best_return": f"{max(float(row['episode_return']) for row in evaluations):.1f}",
            "hours": f"{float(last['wall_seconds']) / 3600:.1f}",
            "median_updates_per_second": f"{statistics.median(speeds):.2f}" if speeds else "",
        })
    if rows:
        with open(HERE / "summary.csv", "w", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows(rows)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("names", nargs="*", help=f"all by default: {', '.join([*EXPERIMENTS, *STUDIES])}")
    options.add_argument("--hksl", default="target/release/hksl", help="the binary")
    options.add_argument("--runs", default="runs", help="where the runs are kept")
    options.add_argument("--threads", default="0", help="CPU threads")
    options.add_argument("--collect", action="store_true", help="run nothing, collect what the runs have and tabulate studies")
    options.add_argument("--draw", action="store_true", help="run nothing, draw what is here")
    options = options.parse_args()
    if options.draw:
        tabulate_studies()
        return draw()
    for name in options.names or [*EXPERIMENTS, *STUDIES]:
        if name in STUDIES:
            if not options.collect:
                study = ROOT / f"configs/studies/{name}.toml"
                code = subprocess.run([options.hksl, "sweep", study, "--runs", options.runs]).returncode
            collect_study(name, options.runs, options.hksl)
            if not options.collect and code != 0:
                sys.exit(code)
            continue
        if name not in EXPERIMENTS:
            sys.exit(f"unknown experiment {name}; there are {', '.join([*EXPERIMENTS, *STUDIES])}")
        arguments = [*EXPERIMENTS[name], "--threads", options.threads]
        run = folder(arguments, options.runs, options.hksl)
        print(f"{name}: {run}", flush=True)
        if options.collect:
            if (run / "eval.csv").is_file():
                collect(name, run)
            continue
        # A session of its own: Ctrl-C then reaches it once, through here.
        process = subprocess.Popen([options.hksl, "train", *arguments, "--runs", options.runs],
                                   start_new_session=True)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
            signal.signal(number, lambda number, _: process.send_signal(number))
        code = process.wait()
        collect(name, run)
        if code != 0:
            sys.exit(code)
    tabulate_studies()
    if not options.collect:
        draw()


if __name__ == "__main__":
    main()
