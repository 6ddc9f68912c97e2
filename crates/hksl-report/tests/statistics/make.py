#!/usr/bin/env python3
"""Makes rliable.json beside this file: scores, and what rliable says of them.

    pip install rliable==1.2.0 "pandas<3" && python3 make.py

(pandas 3 breaks arch 7.2, which rliable imports.) It takes some minutes: rliable's probability of improvement calls
scipy once for each task and replicate.

Exact intervals come from rliable's own functions while numpy.random.choice, from which rliable draws runs, is
replaced by SplitMix64 (Steele, Lea and Flood, OOPSLA 2014). Whoever knows the seed then knows every index, and none
has to be stored. The others use numpy's generator, and store what a correct bootstrap of 50,000 replicates should
stay within.
"""

import json
import math
import pathlib
import warnings

import numpy
import scipy
from rliable import library, metrics

TAUS = [0.8, -0.05, 0.0, 0.13, 0.25, 0.37, 0.5, 0.62, 1.01, 1.3]
GAMMAS = [1.0, 0.6]
EXACT_REPLICATES = 2000
# Replicates of the Rust side, and how many standard deviations a percentile may lie off.
REPLICATES = 50_000
DEVIATIONS = 4.0
TAIL = 0.025


class SplitMix64:
    """The generator, in place of numpy.random.choice."""

    def __init__(self, seed):
        self.state = seed

    def next(self):
        self.state = (self.state + 0x9E3779B97F4A7C15) % 2**64
        mixed = self.state
        mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9 % 2**64
        mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EB % 2**64
        return mixed ^ (mixed >> 31)

    def choice(self, count, shape, replace):
        """Indices in row-major order. Low bits are as good as high ones, and the bias of % is below 1e-18."""
        assert replace
        return numpy.array([self.next() % count for _ in range(math.prod(shape))]).reshape(shape)


def aggregates(scores):
    gaps = [metrics.aggregate_optimality_gap(scores, gamma) for gamma in GAMMAS]
    first = [metrics.aggregate_iqm(scores), metrics.aggregate_mean(scores), metrics.aggregate_median(scores)]
    return numpy.array(first + gaps)


def improvement(x, y):
    return numpy.array([metrics.probability_of_improvement(x, y)])


def profile(scores):
    return library.score_distributions(scores, TAUS)


def profile_of_means(scores):
    return library.average_score_distributions(scores, TAUS)


def iqm_curve(scores):
    """Of runs × tasks × checkpoints."""
    return numpy.array([metrics.aggregate_iqm(scores[..., frame]) for frame in range(scores.shape[-1])])


def exact(data, function, seed, confidence=0.95):
    """Points and intervals with the indices of SplitMix64."""
    chosen, numpy.random.choice = numpy.random.choice, SplitMix64(seed).choice
    try:
        points, intervals = library.get_interval_estimates(
            {"": data}, function, reps=EXACT_REPLICATES, confidence_interval_size=confidence
        )
    finally:
        numpy.random.choice = chosen
    return {"point": points[""].tolist(), "low": intervals[""][0].tolist(), "high": intervals[""][1].tolist()}


def bands(data, function, replicates):
    """Where each bound of many other replicates should lie: order statistics of these around it."""
    several = isinstance(data, list)
    resampler = library.StratifiedIndependentBootstrap(*data) if several else library.StratifiedBootstrap(data)
    values = resampler.apply(function, replicates)
    width = DEVIATIONS * math.sqrt(TAIL * (1 - TAIL) * (1 / replicates + 1 / REPLICATES))
    low = numpy.quantile(values, [TAIL - width, TAIL + width], axis=0).T
    high = numpy.quantile(values, [1 - TAIL - width, 1 - TAIL + width], axis=0).T
    return {"low": low.tolist(), "high": high.tolist()}


def case(name, x, y, seed):
    return {
        "name": name,
        "x": x.tolist(),
        "y": y.tolist(),
        "seed": seed,
        "exact": {
            "aggregates": exact(x, aggregates, seed),
            "aggregates_80": exact(x, aggregates, seed, 0.8),
            "improvement": exact([x, y], improvement, seed),
            "profile": exact(x, profile, seed),
            "profile_of_means": exact(x, profile_of_means, seed),
        },
        "bands": {
            "aggregates": bands(x, aggregates, 20_000),
            "improvement": bands([x, y], improvement, 5_000),
            "profile": bands(x, profile, 10_000),
            "profile_of_means": bands(x, profile_of_means, 10_000),
        },
    }


def cases(random):
    golden = [[0.1, 0.9], [0.5, 0.8], [0.3, 1.2], [0.7, 0.4], [0.2, 0.6]]
    yield "golden", numpy.array(golden), numpy.array([[0.2, 0.5], [0.5, 0.7], [0.1, 0.9], [0.4, 0.4], [0.6, 0.3]])
    yield "5 × 3", random.uniform(0, 1, (5, 3)), random.uniform(0.1, 0.9, (5, 3))
    # Negative scores, some above 1, and another number of runs of the other method.
    yield "10 × 6", random.normal(0.5, 0.4, (10, 6)).round(3), random.normal(0.4, 0.3, (7, 6)).round(3)
    # Quarters are exact, so that equal scores are so on every side; the first two columns are each other's.
    x, y = random.integers(0, 5, (6, 4)) / 4, random.integers(0, 5, (6, 4)) / 4
    y[:, :2] = x[:, :2]
    yield "ties", x, y
    yield "1 × 4", random.uniform(0, 1, (1, 4)), random.uniform(0, 1, (1, 4))
    yield "5 × 1", random.uniform(0, 1, (5, 1)), random.uniform(0, 1, (4, 1))


def percentiles(random):
    for count in [1, 2, 7, 40]:
        values = random.normal(size=count).round(6)
        percents = [0.0, 2.5, 31.0, 50.0, 97.5, 100.0]
        found = numpy.percentile(values, percents)
        yield {"values": values.tolist(), "percents": percents, "found": found.tolist()}


def main():
    warnings.filterwarnings("ignore")
    random = numpy.random.default_rng(20)
    numpy.random.seed(21)
    all_cases = [case(name, x, y, 100 + at) for at, (name, x, y) in enumerate(cases(random))]
    frames = random.uniform(0, 1, (5, 3, 4)).round(4)
    result = {
        "made_with": {"rliable": "1.2.0", "numpy": numpy.__version__, "scipy": scipy.__version__},
        "taus": TAUS,
        "gammas": GAMMAS,
        "replicates": EXACT_REPLICATES,
        "cases": all_cases,
        # Runs × tasks × checkpoints.
        "curve": {"scores": frames.tolist(), "seed": 99, "exact": exact(frames, iqm_curve, 99)},
        "percentiles": list(percentiles(random)),
    }
    path = pathlib.Path(__file__).with_name("rliable.json")
    path.write_text(json.dumps(result, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
