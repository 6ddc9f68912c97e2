#!/usr/bin/env python3
"""Looks into the runs of results/learning and keeps tables and pictures here, each call in a folder of its own.

What is there is not made again: remove a folder to have it anew. Runs that are not done yet are left out, and said; a
folder that was made without them is made again once they are.
Needs Python alone.

    python3 results/analysis/run.py --hksl target/release/hksl --runs /where/results/learning/run.py/kept/them
"""

import argparse
import pathlib
import shutil
import subprocess

HERE = pathlib.Path(__file__).resolve().parent

CARTPOLE = "cartpole-swingup/hksl/seed-1"
NO_REPRESENTATION = "cartpole-swingup/hksl-no-repr/seed-1"
OTHERS = ["cartpole-swingup/drq/seed-1", "cartpole-swingup/curl/seed-1"]
FALLING_PIXELS = [f"falling-pixels/{name}/seed-1" for name in ("hksl", "hksl-no-repr", "hksl-pad-0")]
RUNS = [CARTPOLE, NO_REPRESENTATION, *OTHERS, *FALLING_PIXELS]

# folder: the command's words; paths are relative to the folder of runs, so that no machine's paths are kept.
ANALYSES = {
    "probe": ["probe", CARTPOLE, NO_REPRESENTATION, "--checkpoints", "0,50000,100000"],
    "probe-methods": ["probe", CARTPOLE, NO_REPRESENTATION, *OTHERS, "--checkpoints", "50000"],
    "probe-falling-pixels-agent": ["probe", *FALLING_PIXELS, "--checkpoints", "0,20000,40000,60000",
                                   "--coordinates", "agent_column"],
    "probe-falling-pixels-pixels": ["probe", *FALLING_PIXELS, "--checkpoints", "0,20000,40000,60000",
                                    "--coordinates", "pixel_row"],
    "channel-untrained": ["analyze-comm", CARTPOLE, "--checkpoint", "0"],
    "channel-50000": ["analyze-comm", CARTPOLE, "--checkpoint", "50000"],
    "channel-100000": ["analyze-comm", CARTPOLE, "--checkpoint", "100000"],
    "attention-50000": ["attention", CARTPOLE, "--checkpoint", "50000", "--count", "4"],
    "attention-100000": ["attention", CARTPOLE, "--checkpoint", "100000", "--count", "4"],
}
# Too large to keep, and made again by the command.
LEFT_OUT = ["maps.csv", "episode.gif"]
# Names the runs that a folder was made without.
WITHOUT = "without.txt"


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--hksl", default="target/release/hksl", help="the binary")
    options.add_argument("--runs", default="runs", help="where the runs are")
    options = options.parse_args()
    hksl = pathlib.Path(options.hksl).resolve()
    for name, words in ANALYSES.items():
        folder = HERE / name
        missing = [word for word in words if word in RUNS and not pathlib.Path(options.runs, word, "done").is_file()]
        without = folder / WITHOUT
        was_missing = without.read_text().splitlines() if without.is_file() else []
        if set(was_missing) - set(missing):
            shutil.rmtree(folder)
        if folder.exists():
            print(f"{name}: is there")
            continue
        words = [word for word in words if word not in missing]
        if missing:
            print(f"{name}: without {', '.join(missing)}, which is not done")
        print(f"{name}: hksl {' '.join(words)}", flush=True)
        table = subprocess.run([hksl, *words, "--out", folder], cwd=options.runs, check=True,
                               stdout=subprocess.PIPE, text=True).stdout
        # The last line names this machine's folder.
        kept = [line for line in table.splitlines() if str(folder) not in line]
        if kept:
            (folder / "table.txt").write_text("".join(line + "\n" for line in kept))
        if missing:
            without.write_text("".join(run + "\n" for run in missing))
        for file in LEFT_OUT:
            (folder / file).unlink(missing_ok=True)


if __name__ == "__main__":
    main()
