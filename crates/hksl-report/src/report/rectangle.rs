//! Selection of methods and tasks for a fair comparison.

use std::collections::BTreeSet;

/// Largest number of sets of shared tasks to consider, far more than a study has.
const MOST_SETS: usize = 100_000;

/// Selects methods and tasks such that every method has runs on every task, with the most pairs of method and task.
/// Selects at least two methods if any two share a task. With `anchored`, the first method is selected if it has any
/// runs. `has` lists the tasks of each method; returns positions of methods and of tasks, in order.
pub(super) fn rectangle(has: &[Vec<bool>], anchored: bool) -> (Vec<usize>, Vec<usize>) {
    let mask = |tasks: &Vec<bool>| {
        tasks
            .iter()
            .enumerate()
            .fold(0u128, |mask, (task, there)| mask | u128::from(*there) << task)
    };
    let masks: Vec<u128> = has.iter().map(mask).collect();
    let anchor = masks.first().copied().filter(|mask| anchored && *mask != 0).unwrap_or(u128::MAX);
    // All sets of tasks that some methods share.
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
        // A method with one task does not reduce the comparison of the others to that task.
        assert_eq!(of(false, &[".x..", "xxxx", "xxxx"]), (vec![1, 2], vec![0, 1, 2, 3]));
        // The anchored method does.
        assert_eq!(of(true, &[".x..", "xxxx", "xxxx"]), (vec![0, 1, 2], vec![1]));
        assert_eq!(of(true, &["....", "xxxx", "xxxx"]), (vec![1, 2], vec![0, 1, 2, 3]));
        // Two methods on one task are better than one method on many.
        assert_eq!(of(false, &["xxxx", ".x.."]), (vec![0, 1], vec![1]));
        assert_eq!(of(false, &["x...", ".xx."]), (vec![1], vec![1, 2]));
        // Four methods share two tasks, three pairs share three others.
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
