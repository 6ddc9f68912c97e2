"""Times hksl's learning step beside PyTorch's on this machine, alternating, and writes what it saw.

`make bench` runs it. It needs the built `hksl` and a Python with torch, numpy and safetensors; the statement it times
is hksl_torch.py beside it, the same step, written independently. Two runs of PyTorch are timed: as users have it, and
tuned so that its allocator keeps freed memory. Every round runs each program once; the medians are those of all
rounds' medians, so that a machine that slows down meanwhile slows all of them.

Output, in --out: runs.jsonl (every program's own report), comparison.csv, schedules.csv, cost.svg, README.md.
"""

import argparse
import csv
import json
import os
import platform
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
TUNABLES = "glibc.malloc.mmap_threshold=4294967296:glibc.malloc.trim_threshold=8589934592"
TASKS = ["cartpole-swingup", "falling-pixels"]
PASSES = {"sequential": [15, 30, 49, 73], "joint": [13, 23, 34, 47]}
COLOURS = {"sequential": "#1b6ca8", "joint": "#d1495b"}


def run(command, environment=None):
    result = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **(environment or {})})
    if result.returncode != 0:
        sys.exit(f"{' '.join(command)} failed:\n{result.stderr}")
    return json.loads(result.stdout.strip().splitlines()[-1])


def hksl(args, task, *options):
    command = [args.hksl, "bench", "step", task, "--device", "cpu", "--json", "--threads", str(args.threads)]
    return run(command + ["--batch", str(args.batch), "--runs", str(args.runs), *options])


def torch(args, task, tuned):
    command = [args.python, str(HERE / "hksl_torch.py"), "bench", "--preset", task, "--channels-last"]
    command += ["--threads", str(args.threads), "--batch", str(args.batch), "--runs", str(args.runs), "--warmup", "2"]
    return run(command, {"GLIBC_TUNABLES": TUNABLES} if tuned else None)


def programs(args):
    """Name, task and how to run each program of a round."""
    for task in TASKS:
        for schedule in ["sequential", "joint"]:
            options = ["--set", f"hksl.update_schedule={schedule}"]
            yield f"hksl, {schedule}", task, lambda task=task, options=options: hksl(args, task, *options)
        yield "PyTorch, tuned", task, lambda task=task: torch(args, task, True)
        yield "PyTorch, as users have it", task, lambda task=task: torch(args, task, False)


def compare(args, log):
    medians, reports = {}, {}
    for number in range(args.rounds):
        for name, task, start in programs(args):
            print(f"round {number + 1} of {args.rounds}: {task}, {name}", file=sys.stderr, flush=True)
            report = start()
            log.write(json.dumps({"round": number, "program": name, "task": task, **report}) + "\n")
            medians.setdefault((task, name), []).append(report["median_s"])
            reports.setdefault((task, name), []).append(report)
    rows = []
    for (task, name), seconds in medians.items():
        median = statistics.median(seconds)
        ratio = {n: statistics.median(medians[task, f"PyTorch, {n}"]) / median for n in ["tuned", "as users have it"]}
        rows.append({
            "task": task, "program": name, "median_s": round(median, 4), "min_s": round(min(seconds), 4),
            "max_s": round(max(seconds), 4), "rounds": len(seconds),
            "times_as_fast_as_tuned": round(ratio["tuned"], 2),
            "times_as_fast_as_plain": round(ratio["as users have it"], 2),
        })
    return rows, {of: typical(rounds) for of, rounds in reports.items()}


def typical(reports):
    """The report of the median round, with the peak that the machine was measured at in any."""
    chosen = sorted(reports, key=lambda report: report["median_s"])[len(reports) // 2]
    peaks = [report["peak_gflops"] for report in reports if "peak_gflops" in report]
    return {**chosen, **({"peak_gflops": max(peaks)} if peaks else {})}


def schedules(args, log):
    """Both schedules for one to four levels: cartpole-swingup, n = 1, 3, 5, 7 cut to h, k = 7."""
    rows = []
    for levels in range(1, 5):
        skips = [1, 3, 5, 7][:levels]
        for schedule in ["sequential", "joint"]:
            print(f"h = {levels}, {schedule}", file=sys.stderr, flush=True)
            settings = [f"hksl.skips={skips}", "hksl.trajectory_length=7", f"hksl.update_schedule={schedule}"]
            options = [part for setting in settings for part in ["--set", setting]]
            report = hksl(args, "cartpole-swingup", *options)
            log.write(json.dumps({"program": f"hksl, {schedule}", "h": levels, **report}) + "\n")
            assert report["encoder_passes"] == PASSES[schedule][levels - 1], report
            phases = {f"{name}_s": round(seconds, 4) for name, seconds in report["phases"].items()}
            rows.append({"levels": levels, "schedule": schedule, "encoder_passes": report["encoder_passes"],
                         "median_s": round(report["median_s"], 4), "min_s": round(report["min_s"], 4),
                         "max_s": round(report["max_s"], 4), **phases})
    return rows


def write_csv(path, rows):
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def plot(path, rows):
    """Seconds of a step against the number of levels, one line a schedule."""
    width, height, left, top, right, bottom = 560, 360, 64, 40, 120, 52
    most = max(row["median_s"] for row in rows)
    tick = next(t for t in [0.1, 0.2, 0.25, 0.5, 1, 2, 5, 10] if most / t <= 6)
    top_value = tick * (int(most / tick) + 1)
    x = lambda levels: left + (levels - 1) / 3 * (width - left - right)
    y = lambda seconds: height - bottom - seconds / top_value * (height - top - bottom)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
             f'font-size="13"><rect width="{width}" height="{height}" fill="white"/>'
             f'<text x="{left}" y="22" font-size="14">One learning step, cartpole-swingup, k = 7</text>']
    for index in range(round(top_value / tick) + 1):
        value = index * tick
        parts.append(f'<line x1="{left}" x2="{width - right}" y1="{y(value):.1f}" y2="{y(value):.1f}" stroke="#ddd"/>'
                     f'<text x="{left - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>')
    for levels in range(1, 5):
        parts.append(f'<text x="{x(levels):.1f}" y="{height - bottom + 20}" text-anchor="middle">{levels}</text>')
    parts.append(f'<text x="{(left + width - right) / 2}" y="{height - 12}" text-anchor="middle">levels h</text>'
                 f'<text x="16" y="{(height + top - bottom) / 2}" text-anchor="middle" '
                 f'transform="rotate(-90 16 {(height + top - bottom) / 2})">seconds</text>')
    for schedule, colour in COLOURS.items():
        points = [(x(row["levels"]), y(row["median_s"]), row) for row in rows if row["schedule"] == schedule]
        line = " ".join(f"{px:.1f},{py:.1f}" for px, py, _ in points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        shift = -10 if schedule == "sequential" else 20
        for px, py, row in points:
            parts.append(f'<circle cx="{px:.1f}" cy="{py:.1f}" r="4" fill="{colour}"/>'
                         f'<text x="{px:.1f}" y="{py + shift:.1f}" text-anchor="middle" font-size="11" '
                         f'fill="{colour}">{row["encoder_passes"]}</text>')
        px, py, _ = points[-1]
        parts.append(f'<text x="{px + 14:.1f}" y="{py + 5:.1f}" fill="{colour}">{schedule}</text>')
    parts.append(f'<text x="{width - right + 8}" y="{height - 28}" font-size="11" fill="#666">at the points:</text>'
                 f'<text x="{width - right + 8}" y="{height - 14}" font-size="11" fill="#666">encoder passes</text></svg>')
    path.write_text("\n".join(parts) + "\n")


def first_line(command):
    try:
        return subprocess.run(command, capture_output=True, text=True).stdout.strip().splitlines()[0]
    except (OSError, IndexError):
        return "unknown"


def machine(args, report):
    name = platform.processor() or "unknown CPU"
    try:
        models = [line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
        memory = int(next(line.split()[1] for line in open("/proc/meminfo") if line.startswith("MemTotal"))) / 2**20
        name = f"{models[0]}, {len(models)} logical cores, {memory:.0f} GiB"
    except (OSError, StopIteration, IndexError):
        pass
    version = first_line([args.python, "-c", "import torch; print(torch.__version__)"])
    return (f"{name}; {platform.system()}; {report['kernels']} kernels; {report['peak_gflops']:.0f} GFLOP/s of fused "
            f"multiply-adds on {args.threads} threads (measured); {first_line(['rustc', '--version'])}; "
            f"PyTorch {version}")


def table(rows, columns):
    lines = ["| " + " | ".join(columns.values()) + " |", "|" + "---|" * len(columns)]
    return "\n".join(lines + ["| " + " | ".join(str(row[key]) for key in columns) + " |" for row in rows])


def rate(seconds, gflop, peak):
    return f"{seconds:.4f} s, {gflop:.1f} GFLOP, {gflop / seconds:.0f} GFLOP/s, {100 * gflop / seconds / peak:.0f} % of the peak"


def describe(args, rows, reports, cost):
    report = reports["cartpole-swingup", "hksl, sequential"]
    text = ["# The learning step, beside PyTorch", "",
            f"Written by `make bench` ({args.rounds} rounds of {args.runs} steps, {args.threads} threads, batch "
            f"{args.batch}, f32, every phase in every step).", "", f"Machine: {machine(args, report)}.", "",
            "PyTorch runs `bench/hksl_torch.py bench --channels-last`: tuned with an allocator that keeps freed memory "
            f"(`GLIBC_TUNABLES={TUNABLES}`), and as users have it. Seconds are the median, least and most of the "
            "rounds' medians.", ""]
    for task in TASKS:
        columns = {"program": task, "median_s": "median s", "min_s": "least", "max_s": "most",
                   "times_as_fast_as_tuned": "× tuned PyTorch", "times_as_fast_as_plain": "× plain PyTorch"}
        text += [table([row for row in rows if row["task"] == task], columns), ""]
    text += ["## Where the time goes", ""]
    for task in TASKS:
        for schedule in ["sequential", "joint"]:
            report = reports[task, f"hksl, {schedule}"]
            phases = ", ".join(f"{name.replace('_', ' ')} {seconds:.4f}" for name, seconds in
                               sorted(report["phases"].items(), key=lambda item: -item[1]))
            peak = report["peak_gflops"]
            text += [f"- {task}, {schedule}: {rate(report['median_s'], report['gflop'], peak)} "
                     f"({report['gflop_executed']:.1f} GFLOP executed); seconds by phase: {phases}; "
                     f"{report['encoder_passes']} encoder passes; at most {report['page_faults_per_step']} page faults "
                     "in a step."]
        report = reports[task, "hksl, sequential"]
        text += [f"- {task}, one encoder forward and backward: "
                 f"{rate(report['encoder_forward_backward_s'], report['encoder_gflop'], report['peak_gflops'])} "
                 f"({report['encoder_gflop_executed']:.1f} GFLOP executed)."]
    columns = {"levels": "h", "schedule": "schedule", "encoder_passes": "encoder passes", "median_s": "median s",
               "min_s": "least", "max_s": "most", "representation_s": "representation", "critics_s": "critics",
               "actor_s": "actor"}
    text += ["", "GFLOP count convolutions by their definition; executed is what the kernels multiply.", "",
             "## Cost against the number of levels", "",
             "cartpole-swingup, n = 1, 3, 5, 7 cut to h, k = 7 (docs/update-schedule.md says what the schedules are). "
             "The joint schedule's two backward passes are counted among the critics.", "",
             "![Seconds of a step against h](cost.svg)", "", table(cost, columns), ""]
    return "\n".join(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hksl", default="target/release/hksl", help="the built binary")
    parser.add_argument("--python", default=sys.executable, help="a Python that has torch")
    parser.add_argument("--out", type=Path, default=HERE.parent / "results" / "learning-step")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--runs", type=int, default=5, help="timed steps of each program in each round")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--batch", type=int, default=128)
    args = parser.parse_args()
    check = subprocess.run([args.python, "-c", "import torch, numpy, safetensors"], capture_output=True, text=True)
    if check.returncode != 0:
        sys.exit(f"{args.python} lacks a package: {check.stderr.strip().splitlines()[-1]}\n"
                 "install torch, numpy and safetensors there, or name another: make bench PYTHON=.../bin/python")
    args.out.mkdir(parents=True, exist_ok=True)
    with open(args.out / "runs.jsonl", "w") as log:
        rows, reports = compare(args, log)
        cost = schedules(args, log)
    write_csv(args.out / "comparison.csv", rows)
    write_csv(args.out / "schedules.csv", cost)
    plot(args.out / "cost.svg", cost)
    (args.out / "README.md").write_text(describe(args, rows, reports, cost))
    print(f"{args.out}/README.md")
    for row in rows:
        print(f"  {row['task']:<17} {row['program']:<26} {row['median_s']:8.4f} s  "
              f"{row['times_as_fast_as_tuned']:5.2f} × tuned, {row['times_as_fast_as_plain']:5.2f} × plain")


if __name__ == "__main__":
    main()
