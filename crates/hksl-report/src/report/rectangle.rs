//! Which methods can be compared on which tasks.

use std::collections::BTreeSet;

/// More sets of shared tasks than any study has; beyond, the largest of these is taken.
const MOST_SETS: usize = 100_000;

/// Of methods that do not all have runs on the same tasks, the choice with the most pairs of method and task in which
/// every method has runs on every task; two methods at least, where two share a task. With `anchored` the first method
/// is one of them, if it has runs at all. `has` gives each method's tasks; both lists come back in their order, as
/// positions.
pub(super) fn rectangle(has: &[Vec<bool>], anchored: bool) -> (Vec<usize>, Vec<usize>) {
    let mask = |tasks: &Vec<bool>| {
        tasks
            .iter()
            .enumerate()
            .fold(0u128, |mask, (task, there)| mask | u128::from(*there) << task)
    };
    let masks: Vec<u128> = has.iter().map(mask).collect();
    let anchor = masks.first().copied().filter(|mask| anchored && *mask != 0).unwrap_or(u128::MAX);
    // Every set of tasks that some methods share.
    let mut shared: BTreeSet<u128> = BTreeSet::new();
    for &mask in &masks {
        let mask = mask & anchor;
        let mut next: BTreeSet<u128> = shared.iter().map(|known| known & mask).collect();
        next.insert(mask);
        shared.extend(next.into_iter().take(MOST_SETS.saturating_sub(shared.len())));
    }
    let of = |tasks: u128| -> Vec<usize> {
        (0..masks.len()).filter(|&method| masks[method] & tasks == tasks).collect()
    };
    let worth = |tasks: u128| {
        let methods = of(tasks).len();
        (methods > 1, methods * tasks.count_ones() as usize, methods)
    };
    let best = shared.into_iter().filter(|tasks| *tasks != 0).max_by_key(|tasks| worth(*tasks));
    let Some(best) = best else {
        return (Vec::new(), Vec::new());
    };
    let tasks = (0..u128::BITS as usize).filter(|task| best >> task & 1 == 1);
    (of(best), tasks.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(anchored: bool, table: &[&str]) -> (Vec<usize>, Vec<usize>) {
        let has: Vec<Vec<bool>> =
            table.iter().map(|row| row.chars().map(|there| there == 'x').collect()).collect();
        rectangle(&has, anchored)
    }

    #[test]
    fn the_largest_comparison_is_found() {
        assert_eq!(of(false, &["xxxx", "xxxx"]), (vec![0, 1], vec![0, 1, 2, 3]));
        // A method with one task does not take the other three from the rest.
        assert_eq!(of(false, &[".x..", "xxxx", "xxxx"]), (vec![1, 2], vec![0, 1, 2, 3]));
        // Unless it is what the comparison is about.
        assert_eq!(of(true, &[".x..", "xxxx", "xxxx"]), (vec![0, 1, 2], vec![1]));
        assert_eq!(of(true, &["....", "xxxx", "xxxx"]), (vec![1, 2], vec![0, 1, 2, 3]));
        // Two methods are a comparison where one is none, however many tasks it has.
        assert_eq!(of(false, &["xxxx", ".x.."]), (vec![0, 1], vec![1]));
        assert_eq!(of(false, &["x...", ".xx."]), (vec![1], vec![1, 2]));
        // Four methods share two tasks; each has a partner on three others.
        let four = [
            "xxxxx......",
            "..xxx......",
            "xx...xxx...",
            ".....xxx...",
            "xx......xxx",
            "xx.........",
        ];
        assert_eq!(of(false, &four), (vec![0, 2, 4, 5], vec![0, 1]));
        assert_eq!(of(false, &["...."]), (vec![], vec![]));
        assert_eq!(of(false, &[]), (vec![], vec![]));
    }
}
