//! Which methods can be compared on which tasks.

/// Of methods that do not all have runs on the same tasks, a choice for which all have: as many pairs of method and
/// task as can be found, two methods at least where two share a task. Grown from each method in turn by the one that
/// leaves the most pairs; both lists keep their order.
pub(super) fn rectangle<'a>(
    variants: &[&'a str],
    tasks: &[String],
    has: impl Fn(&str, &str) -> bool,
) -> (Vec<&'a str>, Vec<String>) {
    let of: Vec<Vec<bool>> = variants
        .iter()
        .map(|variant| tasks.iter().map(|task| has(variant, task)).collect())
        .collect();
    let count = |shared: &[bool]| shared.iter().filter(|there| **there).count();
    let both = |one: &[bool], two: &[bool]| -> Vec<bool> {
        one.iter().zip(two).map(|(a, b)| *a && *b).collect()
    };
    let mut best: (usize, Vec<usize>, Vec<bool>) = (0, Vec::new(), vec![false; tasks.len()]);
    for start in 0..variants.len() {
        let (mut chosen, mut shared) = (vec![start], of[start].clone());
        loop {
            let pairs = chosen.len() * count(&shared);
            let single = |chosen: &[usize]| chosen.len() < 2;
            let better = match (single(&chosen), single(&best.1)) {
                (true, false) => false,
                (false, true) => pairs > 0,
                _ => pairs > best.0,
            };
            if better {
                best = (pairs, chosen.clone(), shared.clone());
            }
            let others = (0..variants.len()).filter(|other| !chosen.contains(other));
            // The first of those that leave as much.
            let next = others.rev().max_by_key(|&other| count(&both(&shared, &of[other])));
            let Some(next) = next.filter(|&next| count(&both(&shared, &of[next])) > 0) else {
                break;
            };
            shared = both(&shared, &of[next]);
            chosen.push(next);
        }
    }
    let (_, mut chosen, shared) = best;
    chosen.sort_unstable();
    let tasks = tasks.iter().zip(shared).filter(|(_, there)| *there).map(|(task, _)| task.clone());
    (chosen.into_iter().map(|index| variants[index]).collect(), tasks.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(table: &[(&'static str, &[&str])]) -> (Vec<&'static str>, Vec<String>) {
        let variants: Vec<&str> = table.iter().map(|(variant, _)| *variant).collect();
        let tasks: Vec<String> = ["a", "b", "c", "d"].map(str::to_owned).into();
        rectangle(&variants, &tasks, |variant, task| {
            table.iter().any(|(name, tasks)| *name == variant && tasks.contains(&task))
        })
    }

    #[test]
    fn the_largest_comparison_is_found() {
        let all: &[&str] = &["a", "b", "c", "d"];
        let names =
            |(variants, tasks): (Vec<&str>, Vec<String>)| (variants.join(" "), tasks.join(" "));
        assert_eq!(names(of(&[("x", all), ("y", all)])), ("x y".into(), "a b c d".into()));
        // A method with one task does not take the other three from the rest.
        let one: &[&str] = &["b"];
        assert_eq!(
            names(of(&[("one", one), ("x", all), ("y", all)])),
            ("x y".into(), "a b c d".into())
        );
        // Two methods are a comparison where one is none, however many tasks it has.
        assert_eq!(names(of(&[("x", all), ("one", one)])), ("x one".into(), "b".into()));
        assert_eq!(names(of(&[("x", &["a"]), ("y", &["b", "c"])])), ("y".into(), "b c".into()));
        assert_eq!(names(of(&[("x", &[])])), (String::new(), String::new()));
        assert_eq!(names(of(&[])), (String::new(), String::new()));
    }
}
