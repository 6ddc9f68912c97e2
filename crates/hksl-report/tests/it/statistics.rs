//! Against rliable, on stored numbers (`fixtures/make.py`).

use hksl_report::statistics::{
    Aggregate, Bootstrap, Estimate, ProfileOf, Scores, aggregate_intervals, curve,
    improvement_interval, interval, iqm, percentile, performance_profile,
    probability_of_improvement, profile_intervals, profile_of_means,
};
use serde_json::Value;

/// What numbers in the same arithmetic may differ by, for sums in another order.
const EXACT: f64 = 1e-12;

fn fixture() -> Value {
    serde_json::from_str(include_str!("../statistics/rliable.json")).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn rows(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().unwrap().iter().map(numbers).collect()
}

fn scores(value: &Value) -> Scores {
    Scores::from_rows(&rows(value)).unwrap()
}

fn count(value: &Value) -> usize {
    value.as_u64().unwrap() as usize
}

fn aggregates(fixture: &Value) -> Vec<Aggregate> {
    let gaps = numbers(&fixture["gammas"]).into_iter();
    let gaps = gaps.map(|gamma| Aggregate::OptimalityGap { gamma });
    [Aggregate::Iqm, Aggregate::Mean, Aggregate::Median].into_iter().chain(gaps).collect()
}

/// The generator that stood in for numpy's.
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Draws of runs (N, M, L), run by run, as a list for each of the L · M strata.
    fn strata(&mut self, [runs, tasks, checkpoints]: [usize; 3]) -> Vec<Vec<usize>> {
        let mut strata = vec![Vec::with_capacity(runs); checkpoints * tasks];
        for cell in 0..runs * tasks * checkpoints {
            let (task, checkpoint) = (cell / checkpoints % tasks, cell % checkpoints);
            strata[checkpoint * tasks + task].push((self.next() % runs as u64) as usize);
        }
        strata
    }
}

/// Replicates as rliable drew them, of matrices of as many runs and tasks.
fn given(seed: &Value, replicates: &Value, shapes: &[[usize; 3]]) -> Bootstrap {
    let mut random = SplitMix64(seed.as_u64().unwrap());
    let mut one = || shapes.iter().flat_map(|&shape| random.strata(shape)).collect();
    Bootstrap::given((0..count(replicates)).map(|_| one()).collect())
}

fn shape(scores: &Value) -> [usize; 3] {
    let rows = rows(scores);
    [rows.len(), rows[0].len(), 1]
}

fn check_exact(what: &str, found: &[Estimate], expected: &Value) {
    let part = |part: &str, of: fn(&Estimate) -> f64| {
        let expected = numbers(&expected[part]);
        assert_eq!(found.len(), expected.len(), "{what}");
        for (position, (found, expected)) in found.iter().map(of).zip(expected).enumerate() {
            let off = (found - expected).abs();
            assert!(off < EXACT, "{what}, {part} {position}: {found} for {expected}");
        }
    };
    part("point", |one| one.point);
    part("low", |one| one.low);
    part("high", |one| one.high);
}

/// Each bound between two order statistics of rliable's replicates, four standard deviations around the percentile.
fn check_bands(what: &str, found: &[Estimate], bands: &Value) {
    let (lows, highs) = (rows(&bands["low"]), rows(&bands["high"]));
    assert_eq!((found.len(), found.len()), (lows.len(), highs.len()));
    for (position, (found, (low, high))) in found.iter().zip(lows.iter().zip(&highs)).enumerate() {
        for (bound, band) in [(found.low, low), (found.high, high)] {
            let inside = band[0] - EXACT <= bound && bound <= band[1] + EXACT;
            assert!(inside, "{what} {position}: {bound} outside of {band:?}");
        }
    }
}

#[test]
fn points_and_intervals_of_the_same_indices_are_equal() {
    let fixture = fixture();
    let (taus, aggregates) = (numbers(&fixture["taus"]), aggregates(&fixture));
    assert_eq!(fixture["cases"].as_array().unwrap().len(), 6);
    for case in fixture["cases"].as_array().unwrap() {
        let (name, exact) = (case["name"].as_str().unwrap(), &case["exact"]);
        let (x, y) = (scores(&case["x"]), scores(&case["y"]));
        let one = given(&case["seed"], &fixture["replicates"], &[shape(&case["x"])]);
        let both = [shape(&case["x"]), shape(&case["y"])];
        let both = given(&case["seed"], &fixture["replicates"], &both);
        let narrow = Bootstrap { confidence: 0.8, ..one.clone() };
        let check = |what, found: &[Estimate]| {
            check_exact(&format!("{name}: {what}"), found, &exact[what]);
        };
        check("aggregates", &aggregate_intervals(&x, &aggregates, &one).unwrap());
        check("aggregates_80", &aggregate_intervals(&x, &aggregates, &narrow).unwrap());
        let by_closure =
            |&one_of: &Aggregate| interval(&x, |scores| one_of.of(scores), &one).unwrap();
        check("aggregates", &aggregates.iter().map(by_closure).collect::<Vec<_>>());
        check("improvement", &[improvement_interval(&x, &y, &both).unwrap()]);
        check("profile", &profile_intervals(&x, &taus, ProfileOf::Runs, &one).unwrap());
        let of_means = profile_intervals(&x, &taus, ProfileOf::TaskMeans, &one).unwrap();
        check("profile_of_means", &of_means);
    }
}

#[test]
fn statistics_without_intervals_are_the_same() {
    let fixture = fixture();
    let (taus, aggregates) = (numbers(&fixture["taus"]), aggregates(&fixture));
    for case in fixture["cases"].as_array().unwrap() {
        let (x, y) = (scores(&case["x"]), scores(&case["y"]));
        let check = |what: &str, found: Vec<f64>| {
            let estimate = |point| Estimate { point, low: 0.0, high: 0.0 };
            let mut expected = case["exact"][what].clone();
            expected["low"] = vec![0.0; found.len()].into();
            expected["high"] = expected["low"].clone();
            let found: Vec<_> = found.into_iter().map(estimate).collect();
            check_exact(&format!("{}: {what}", case["name"]), &found, &expected);
        };
        check("aggregates", aggregates.iter().map(|one| one.of(&x)).collect());
        check("improvement", vec![probability_of_improvement(&x, &y).unwrap()]);
        check("profile", performance_profile(&x, &taus).unwrap());
        check("profile_of_means", profile_of_means(&x, &taus).unwrap());
    }
}

#[test]
fn intervals_of_own_draws_agree_within_chance() {
    let fixture = fixture();
    let (taus, aggregates) = (numbers(&fixture["taus"]), aggregates(&fixture));
    for case in fixture["cases"].as_array().unwrap() {
        let (name, bands) = (case["name"].as_str().unwrap(), &case["bands"]);
        let (x, y) = (scores(&case["x"]), scores(&case["y"]));
        let own = Bootstrap::seeded(1, name);
        let check = |what, found: &[Estimate]| {
            check_bands(&format!("{name}: {what}"), found, &bands[what]);
        };
        check("aggregates", &aggregate_intervals(&x, &aggregates, &own).unwrap());
        check("improvement", &[improvement_interval(&x, &y, &own).unwrap()]);
        check("profile", &profile_intervals(&x, &taus, ProfileOf::Runs, &own).unwrap());
        let of_means = profile_intervals(&x, &taus, ProfileOf::TaskMeans, &own).unwrap();
        check("profile_of_means", &of_means);
    }
}

#[test]
fn a_curve_of_the_same_indices_is_equal() {
    let fixture = fixture();
    let case = &fixture["curve"];
    let runs: Vec<Vec<Vec<f64>>> = case["scores"].as_array().unwrap().iter().map(rows).collect();
    let [run_count, tasks, checkpoints] = [runs.len(), runs[0].len(), runs[0][0].len()];
    let at = |checkpoint: usize| {
        let row = |tasks: &Vec<Vec<f64>>| tasks.iter().map(|task| task[checkpoint]).collect();
        Scores::from_rows(&runs.iter().map(row).collect::<Vec<Vec<f64>>>()).unwrap()
    };
    let checkpoint_scores: Vec<_> = (0..checkpoints).map(at).collect();
    let shape = [run_count, tasks, checkpoints];
    let bootstrap = given(&case["seed"], &fixture["replicates"], &[shape]);
    let found = curve(&checkpoint_scores, Aggregate::Iqm, &bootstrap).unwrap();
    check_exact("curve", &found, &case["exact"]);
    let points: Vec<_> = checkpoint_scores.iter().map(iqm).collect();
    assert_eq!(found.iter().map(|one| one.point).collect::<Vec<_>>(), points);
}

#[test]
fn percentiles_are_numpys() {
    let fixture = fixture();
    for case in fixture["percentiles"].as_array().unwrap() {
        let mut values = numbers(&case["values"]);
        for _ in 0..2 {
            let percents = numbers(&case["percents"]).into_iter().zip(numbers(&case["found"]));
            for (percent, expected) in percents {
                let found = percentile(&values, percent).unwrap();
                assert!((found - expected).abs() < EXACT, "{percent}: {found} for {expected}");
            }
            values.sort_by(f64::total_cmp);
        }
    }
}
