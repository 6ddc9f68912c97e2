"""Times hksl's learning steps beside PyTorch's on this machine, alternating, and writes what it saw.

`make bench` runs it. It needs the built `hksl` and a Python with torch and numpy. What it times are the same steps, written
independently: hksl_torch.py (HKSL) and baselines_torch.py (DrQ, CURL, SAC) beside it. Every round runs hksl and PyTorch
one after the other for each task and method, in the reverse order every second time; the medians are those of all
rounds' medians, so that a machine that slows down meanwhile slows both. On a CPU, PyTorch is tuned so that its allocator
keeps freed memory, and for HKSL's sequential schedule also timed as users have it; on a GPU it runs the whole step as one
CUDA graph, and is also timed without. hksl and PyTorch must have as many parameters and encoder passes.

Output, in --out: runs.jsonl (machine, settings, every program's own report), and from it alone comparison.csv,
schedules.csv, cost.svg, README.md and the tables between the marks in docs/performance.md; --report writes these again
without measuring.
"""

import argparse
import csv
import json
import os
import platform
import shlex
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
TUNABLES = "glibc.malloc.mmap_threshold=4294967296:glibc.malloc.trim_threshold=8589934592"
TASKS = ["cartpole-swingup", "falling-pixels"]
SCHEDULES = ["sequential", "joint"]
# By method: its name, what hksl is told, and the PyTorch program.
METHODS = {
    "sequential": ("HKSL, sequential", ["--set", "hksl.update_schedule=sequential"], ["hksl_torch.py", "bench"]),
    "joint": ("HKSL, joint", ["--set", "hksl.update_schedule=joint"],
              ["hksl_torch.py", "bench", "--schedule", "joint"]),
    "no-repr": ("HKSL, `no-repr`", ["--ablation", "no-repr"], ["hksl_torch.py", "bench", "--no-repr"]),
    "drq": ("DrQ", ["--method", "drq"], ["baselines_torch.py", "bench", "--method", "drq"]),
    "curl": ("CURL", ["--method", "curl"], ["baselines_torch.py", "bench", "--method", "curl"]),
    "sac": ("SAC", ["--method", "sac"], ["baselines_torch.py", "bench", "--method", "sac"]),
}
MARKS = ("<!-- from results/learning-step, by bench/compare.py -->", "<!-- end -->")
COLOURS = {"sequential": "#1b6ca8", "joint": "#d1495b"}


# Measuring


def run(args, command, environment=None):
    command = [*shlex.split(args.wrapper), *command]
    result = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **(environment or {})})
    if result.returncode != 0:
        sys.exit(f"{shlex.join(command)} failed:\n{result.stderr}")
    try:
        return json.loads(result.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        sys.exit(f"{shlex.join(command)} printed no report:\n{result.stdout}{result.stderr}")


def common(args):
    options = {"device": args.device, "threads": args.threads, "batch": args.batch, "runs": args.runs}
    return [word for name, value in options.items() for word in (f"--{name}", str(value))]


def hksl(args, task, options):
    return run(args, [args.hksl, "bench", "step", task, "--json", *common(args), *options])


def torch(args, task, method, tuned):
    program, *options = METHODS[method][2]
    command = [args.python, str(HERE / program), *options, "--preset", task, "--channels-last", *common(args)]
    if on_gpu(args.device):
        return run(args, command + (["--graph"] if tuned else []))
    return run(args, command, {"GLIBC_TUNABLES": TUNABLES} if tuned else None)


def on_gpu(device):
    return device.startswith("cuda")


def programs(args, task, method):
    """Name of each program of a pair, and how to run it."""
    yield "hksl", lambda: hksl(args, task, METHODS[method][1])
    yield "pytorch", lambda: torch(args, task, method, True)
    if method == "sequential" or on_gpu(args.device):
        yield "pytorch_plain", lambda: torch(args, task, method, False)


def compare(args, keep):
    for number in range(args.rounds):
        for task in args.tasks:
            for method in args.methods:
                order = list(programs(args, task, method))
                for program, start in order if number % 2 == 0 else reversed(order):
                    say(f"round {number + 1} of {args.rounds}: {task}, {method}, {program}")
                    keep({"part": "comparison", "round": number, "task": task, "compared": method, "program": program,
                          **start()})


def schedules(args, keep):
    """Both schedules for one level and more: cartpole-swingup, n = 1, 3, 5, 7 cut to h, k = 7; in two rounds at most, since
    these are the longest steps."""
    rounds = min(args.rounds, 2)
    for number in range(rounds):
        for levels in args.levels:
            for schedule in SCHEDULES:
                say(f"round {number + 1} of {rounds}: h = {levels}, {schedule}")
                settings = [f"hksl.skips={[1, 3, 5, 7][:levels]}", "hksl.trajectory_length=7",
                            f"hksl.update_schedule={schedule}"]
                options = [word for setting in settings for word in ("--set", setting)]
                report = hksl(args, "cartpole-swingup", options)
                keep({"part": "schedules", "round": number, "schedule": schedule, **report})


def say(line):
    print(line, file=sys.stderr, flush=True)


def first_line(command):
    try:
        return subprocess.run(command, capture_output=True, text=True).stdout.strip().splitlines()[0]
    except (OSError, IndexError):
        return "unknown"


def machine():
    name = platform.processor() or platform.machine()
    try:
        models = [line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
        memory = int(next(line.split()[1] for line in open("/proc/meminfo") if line.startswith("MemTotal"))) / 2**20
        name = f"{models[0]}, {len(models)} logical cores, {memory:.0f} GiB"
    except (OSError, StopIteration, IndexError):
        pass
    return {"cpu": name, "system": platform.system(), "rustc": first_line(["rustc", "--version"])}


def measure(args):
    path = args.out / "runs.jsonl"
    settings = {"device": args.device, "rounds": args.rounds, "runs": args.runs, "threads": args.threads,
                "batch": args.batch}
    records = [{"part": "machine", **machine(), **settings}]
    compare(args, records.append)
    schedules(args, records.append)
    path.write_text("".join(json.dumps(record) + "\n" for record in records))


# What came out


def groups(records, part, *keys):
    """The reports of each program of a part, in the order in which they came."""
    found = {}
    for record in records:
        if record["part"] == part:
            found.setdefault(tuple(record[key] for key in keys), []).append(record)
    return found


def of_rounds(reports):
    """Median, least and most of the rounds' medians."""
    seconds = [report["median_s"] for report in reports]
    return statistics.median(seconds), min(seconds), max(seconds)


def typical(reports):
    """The report of the median round."""
    return sorted(reports, key=lambda report: report["median_s"])[len(reports) // 2]


def ratios(ours, theirs):
    """The ratio of the medians, and the least and the most of the rounds' own."""
    of_each = [b["median_s"] / a["median_s"] for a, b in zip(ours, theirs)]
    return of_rounds(theirs)[0] / of_rounds(ours)[0], min(of_each), max(of_each)


def check_alike(task, method, ours, theirs):
    for key in ("encoder_passes", "parameters"):
        if key in ours and ours[key] != theirs[key]:
            sys.exit(f"{task}, {method}: hksl has {ours[key]} {key.replace('_', ' ')}, PyTorch {theirs[key]}")


def peak_of(records):
    """The most that the CPU was measured at in any run; none on a GPU."""
    return max((record.get("peak_gflops") or 0.0 for record in records), default=0.0) or None


def comparison_rows(records, peak):
    """A row for each task and method."""
    found = groups(records, "comparison", "task", "compared", "program")
    rows = []
    for task, method in dict.fromkeys(key[:2] for key in found):
        ours, theirs = found[task, method, "hksl"], found[task, method, "pytorch"]
        plain = found.get((task, method, "pytorch_plain"))
        report = typical(ours)
        check_alike(task, method, report, theirs[0])
        row = {"task": task, "method": method}
        for name, seconds in (("hksl", ours), ("pytorch", theirs)):
            row |= dict(zip((f"{name}_s", f"{name}_least_s", f"{name}_most_s"), rounded(of_rounds(seconds), 4)))
        row |= dict(zip(("ratio", "ratio_least", "ratio_most"), rounded(ratios(ours, theirs), 2)))
        row["pytorch_plain_s"] = rounded(of_rounds(plain), 4)[0] if plain else ""
        row["ratio_to_plain"] = rounded(ratios(ours, plain), 2)[0] if plain else ""
        gflop, rate = report["gflop"], report["gflop"] / of_rounds(ours)[0]
        row |= {"gflop": round(gflop, 1), "gflop_per_s": round(rate),
                "gflop_executed": round(report["gflop_executed"], 1) if report["gflop_executed"] else "",
                "share_of_peak": round(rate / peak, 2) if peak else "", "encoder_passes": report["encoder_passes"],
                "parameters": theirs[0]["parameters"], "hksl_page_faults": most(ours, "page_faults_per_step"),
                "pytorch_page_faults": most(theirs, "page_faults_per_step"), "rounds": len(ours),
                "threads": report["threads"], "batch": report["batch"], "device": report["device"],
                "hksl_kernels": report["kernels"], "pytorch_kernels": theirs[0]["kernels"],
                "peak_gflop_per_s": round(peak) if peak else ""}
        rows.append(row)
    return rows


def rounded(numbers, digits):
    return [round(number, digits) for number in numbers]


def most(reports, key):
    """The largest of a number that not every system reports."""
    return max((report[key] for report in reports if report.get(key) is not None), default="")


def schedule_rows(records):
    rows = []
    for (levels, schedule), reports in groups(records, "schedules", "levels", "schedule").items():
        median, least, greatest = of_rounds(reports)
        report = typical(reports)
        phases = {f"{name}_s": round(seconds, 4) for name, seconds in report["phases"].items()}
        rows.append({"levels": levels, "schedule": schedule, "rounds": len(reports), "encoder_passes": report["encoder_passes"],
                     "gflop": round(report["gflop"], 1), "median_s": round(median, 4), "least_s": round(least, 4),
                     "most_s": round(greatest, 4), "s_per_pass": round(median / report["encoder_passes"], 4), **phases})
    return rows


def write_csv(path, rows):
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def plot(path, rows):
    """Seconds of a step against the number of levels, one line a schedule."""
    width, height, left, top, right, bottom = 560, 360, 64, 40, 120, 52
    greatest = max(row["median_s"] for row in rows)
    tick = next(t for t in [0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5, 1, 2, 5, 10, 50, 250] if greatest / t <= 6)
    top_value = tick * (int(greatest / tick) + 1)
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


def table(rows, columns):
    lines = ["| " + " | ".join(columns.values()) + " |", "|" + "---|" * len(columns)]
    return "\n".join(lines + ["| " + " | ".join(str(row[key]) for key in columns) + " |" for row in rows])


def seconds(row, name):
    return f"{row[f'{name}_s']:.4f} ({row[f'{name}_least_s']:.4f} to {row[f'{name}_most_s']:.4f})"


def shown(rows):
    """The rows as people read them."""
    return [{**row, "name": METHODS[row["method"]][0], "hksl": seconds(row, "hksl"), "pytorch": seconds(row, "pytorch"),
             "times": f"**{row['ratio']:.2f}** ({row['ratio_least']:.2f} to {row['ratio_most']:.2f})",
             "times_plain": f"{row['ratio_to_plain']:.2f}" if row["ratio_to_plain"] else "",
             "share": f"{100 * row['share_of_peak']:.0f} %" if row["share_of_peak"] else ""} for row in rows]


def conditions(settings, records, peak):
    """Machine, devices and settings."""
    ours = next(record for record in records if record.get("program") == "hksl")
    theirs = next(record for record in records if record.get("program") == "pytorch")
    # A GPU's name comes from PyTorch: hksl counts them.
    gpu = f"{theirs['device']}; " if on_gpu(settings["device"]) else ""
    arithmetic = f"{peak:.0f} GFLOP/s of fused multiply-adds on {ours['threads']} threads (measured); " if peak else ""
    return (f"Machine: {settings['cpu']}; {gpu}{settings['system']}; instruction set {ours['kernels']} in hksl, "
            f"{theirs['kernels']} in PyTorch; {arithmetic}{settings['rustc']}; {theirs['implementation']}.")


def describe(settings, records, rows, cost, peak):
    gpu = on_gpu(settings["device"])
    tuned = ("with the whole step as one CUDA graph, f32 without TF32; plain is without the graph" if gpu else
             "tuned with an allocator that keeps freed memory "
             f"(`GLIBC_TUNABLES={TUNABLES}`); plain is without that setting, as users have it")
    text = ["# The learning step, beside PyTorch", "",
            f"Written by `make bench{' DEVICE=' + settings['device'] if gpu else ''}` from `runs.jsonl`: "
            f"{settings['rounds']} alternating rounds of {settings['runs']} steps, {settings['threads']} threads, batch "
            f"{settings['batch']}, f32, every phase in every step.", "", conditions(settings, records, peak), "",
            f"PyTorch runs `bench/hksl_torch.py` and `bench/baselines_torch.py` with `--channels-last`, {tuned}. Both have as "
            "many parameters and encoder passes a step as hksl, which is checked. Seconds are the median, least and most of "
            "the rounds' medians; a ratio is PyTorch's seconds by hksl's, of the medians, and the least and most of the "
            "rounds' own.", ""]
    for task in dict.fromkeys(row["task"] for row in rows):
        columns = {"name": task, "hksl": "hksl, s", "pytorch": "PyTorch, s", "times": "times as fast",
                   "times_plain": "as plain PyTorch"}
        text += [table(shown([row for row in rows if row["task"] == task]), columns), ""]
    text += ["## Where the time goes", "",
             "GFLOP count convolutions by their definition; executed is what the CPU's kernels multiply, and the share of the "
             "peak is by the definition. Page faults are the most in a step, those of PyTorch beside hksl's.", ""]
    for task in dict.fromkeys(row["task"] for row in rows):
        columns = {"name": task, "gflop": "GFLOP", "gflop_executed": "executed", "gflop_per_s": "GFLOP/s",
                   "share": "of the peak", "encoder_passes": "encoder passes", "hksl_page_faults": "page faults",
                   "pytorch_page_faults": "PyTorch's"}
        text += [table(shown([row for row in rows if row["task"] == task]), columns), ""]
    text += ["Seconds by phase, in the median round:", ""]
    for (task, method, program), reports in groups(records, "comparison", "task", "compared", "program").items():
        if program == "hksl":
            phases = sorted(typical(reports)["phases"].items(), key=lambda phase: -phase[1])
            phases = ", ".join(f"{name.replace('_', ' ')} {took:.4f}" for name, took in phases)
            text.append(f"- {task}, {METHODS[method][0]}: {phases}.")
    text.append("")
    for (task, method, program), reports in groups(records, "comparison", "task", "compared", "program").items():
        report = typical(reports)
        if program == "hksl" and method == "sequential" and report["encoder_forward_backward_s"]:
            took, gflop = report["encoder_forward_backward_s"], report["encoder_gflop"]
            text += [f"One encoder forward and backward on {task}: {took:.4f} s, {gflop:.1f} GFLOP "
                     f"({report['encoder_gflop_executed']:.1f} executed), {gflop / took:.0f} GFLOP/s, "
                     f"{100 * gflop / took / peak:.0f} % of the peak.", ""]
    if cost:
        text += describe_cost(cost)
    return "\n".join(text)


def describe_cost(cost):
    columns = {"levels": "h", "schedule": "schedule", "rounds": "rounds", "encoder_passes": "encoder passes", "gflop": "GFLOP",
               "median_s": "median s", "least_s": "least", "most_s": "most", "s_per_pass": "s a pass",
               "representation_s": "representation", "critics_s": "critics", "actor_s": "actor"}
    text = ["## Cost against the number of levels", "",
            "cartpole-swingup, n = 1, 3, 5, 7 cut to h, k = 7 ([what the schedules are](../../docs/update-schedule.md)). The joint "
            "schedule's two backward passes are counted among the critics.", "",
            "![Seconds of a step against h](cost.svg)", "", table(cost, columns), ""]
    for schedule in SCHEDULES:
        of = [row for row in cost if row["schedule"] == schedule]
        added = [f"{b['median_s'] - a['median_s']:.2f} s ({b['encoder_passes'] - a['encoder_passes']} passes)"
                 for a, b in zip(of, of[1:])]
        if added:
            text += [f"Each further level adds to the {schedule} step: {', '.join(added)}.", ""]
    return text


def summary(settings, records, rows, cost, peak):
    """What the documentation has of it."""
    text = [conditions(settings, records, peak), ""]
    for task in dict.fromkeys(row["task"] for row in rows):
        columns = {"name": task, "hksl": "hksl, s", "pytorch": "PyTorch, s", "times": "times as fast",
                   "gflop_per_s": "GFLOP/s", "share": "of the peak", "hksl_page_faults": "page faults"}
        medians = [{**row, "hksl": f"{row['hksl_s']:.3f}", "pytorch": f"{row['pytorch_s']:.3f}",
                    "times": f"**{row['ratio']:.2f}**"} for row in shown([row for row in rows if row["task"] == task])]
        text += [table(medians, columns), ""]
    if cost:
        by_levels = {}
        for row in cost:
            by_levels.setdefault(row["levels"], {"levels": row["levels"]}).update({
                f"{row['schedule']}, s": f"{row['median_s']:.2f}", f"{row['schedule']}, passes": row["encoder_passes"]})
        columns = {name: name for row in by_levels.values() for name in row}
        text += ["Seconds and encoder passes by levels h, cartpole-swingup, n = 1, 3, 5, 7 cut to h, k = 7:", "",
                 table(by_levels.values(), columns), ""]
    return "\n".join(text)


def write_between_marks(path, text):
    page = path.read_text()
    try:
        before, rest = page.split(MARKS[0])
        _, after = rest.split(MARKS[1])
    except ValueError:
        sys.exit(f"{path} has no place between `{MARKS[0]}` and `{MARKS[1]}`")
    path.write_text(f"{before}{MARKS[0]}\n\n{text}\n{MARKS[1]}{after}")


def write(args):
    with open(args.out / "runs.jsonl") as log:
        settings, *records = (json.loads(line) for line in log)
    peak = peak_of(records)
    rows, cost = comparison_rows(records, peak), schedule_rows(records)
    write_csv(args.out / "comparison.csv", rows)
    if cost:
        write_csv(args.out / "schedules.csv", cost)
        plot(args.out / "cost.svg", cost)
    (args.out / "README.md").write_text(describe(settings, records, rows, cost, peak))
    if args.page:
        write_between_marks(args.page, summary(settings, records, rows, cost, peak))
    print(f"{args.out}/README.md\n{conditions(settings, records, peak)}")
    print(f"  {'task':<17} {'method':<11} {'hksl, s':>9} {'PyTorch, s':>11} {'times as fast':>22} {'as plain':>9}")
    for row in shown(rows):
        print(f"  {row['task']:<17} {row['method']:<11} {row['hksl_s']:9.4f} {row['pytorch_s']:11.4f} "
              f"{row['times'].replace('*', ''):>22} {row['times_plain']:>9}")
    for row in cost:
        print(f"  h = {row['levels']}, {row['schedule']:<10} {row['encoder_passes']:3} encoder passes {row['median_s']:9.4f} s")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hksl", default="target/release/hksl", help="the built binary")
    parser.add_argument("--python", default=sys.executable, help="a Python that has torch")
    parser.add_argument("--out", type=Path, help="default: results/learning-step, on a GPU results/learning-step-cuda")
    parser.add_argument("--page", type=Path, help="a page whose marked place gets the tables too; default: docs/performance.md "
                        "if --out is not given and the device is a CPU")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N, for both")
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=TASKS)
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    parser.add_argument("--levels", nargs="*", type=int, choices=range(1, 5), default=[1, 2, 3, 4],
                        help="numbers of levels for which the schedules' cost is measured; none: --levels alone")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--runs", type=int, default=3, help="timed steps of each program in each round, after two others")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--wrapper", default="", help="put before every timed command, such as 'taskset -c 0,1' or 'nice -n -5'")
    parser.add_argument("--report", action="store_true", help="write the tables again from runs.jsonl; nothing is measured")
    args = parser.parse_args()
    for name in ("rounds", "runs", "threads", "batch"):
        if getattr(args, name) < 1:
            parser.error(f"--{name} must be at least 1")
    if not args.out and not on_gpu(args.device):
        args.page = args.page or HERE.parent / "docs" / "performance.md"
    args.out = args.out or HERE.parent / "results" / ("learning-step-cuda" if on_gpu(args.device) else "learning-step")
    return args


def main():
    args = arguments()
    if not args.report:
        wanted = "import torch, numpy" + ("; assert torch.cuda.is_available(), 'no GPU'" if on_gpu(args.device) else "")
        check = subprocess.run([args.python, "-c", wanted], capture_output=True, text=True)
        if check.returncode != 0:
            sys.exit(f"{args.python} cannot run PyTorch: {check.stderr.strip().splitlines()[-1]}\n"
                     "install torch and numpy there, or name another: make bench PYTHON=.../bin/python")
        args.out.mkdir(parents=True, exist_ok=True)
        measure(args)
    write(args)


if __name__ == "__main__":
    main()
