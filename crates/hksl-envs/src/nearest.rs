//! "Did you mean …": the valid names nearest to one that is not.

/// The names of `candidates` nearest to `name`, nearest first, at most three.
///
/// Distance is the number of insertions, deletions, substitutions and swaps of neighbours that
/// turn one into the other, letter case and `-`/`_` ignored. A name counts as near within a third
/// of the longer length (at least 2), or when it contains `name` or is contained in it.
///
/// ```
/// assert_eq!(hksl_envs::nearest("cartpol-swingup", ["cartpole-swingup", "walker-walk"]),
///            ["cartpole-swingup"]);
/// ```
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let wanted = plain(name);
    let mut ranked: Vec<(usize, &str)> = candidates
        .into_iter()
        .filter_map(|candidate| {
            let other = plain(candidate);
            let distance = distance(&wanted, &other);
            let limit = (wanted.len().max(other.len()) / 3).max(2);
            let within =
                !wanted.is_empty() && (contains(&other, &wanted) || contains(&wanted, &other));
            (distance <= limit || within).then_some((distance, candidate))
        })
        .collect();
    ranked.sort();
    ranked.into_iter().take(3).map(|(_, candidate)| candidate).collect()
}

/// Lower case, with one kind of dash.
fn plain(name: &str) -> Vec<char> {
    name.chars().flat_map(char::to_lowercase).map(|c| if c == '_' { '-' } else { c }).collect()
}

fn contains(long: &[char], short: &[char]) -> bool {
    !short.is_empty() && long.windows(short.len()).any(|window| window == short)
}

/// Edit distance with swaps of neighbours (optimal string alignment).
fn distance(a: &[char], b: &[char]) -> usize {
    let mut table = vec![vec![0; b.len() + 1]; a.len() + 1];
    for (i, row) in table.iter_mut().enumerate() {
        row[0] = i;
    }
    for (j, cell) in table[0].iter_mut().enumerate() {
        *cell = j;
    }
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let substitution = table[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = substitution.min(table[i - 1][j] + 1).min(table[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(table[i - 2][j - 2] + 1);
            }
            table[i][j] = best;
        }
    }
    table[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 4] = ["falling-pixels", "cartpole-swingup", "walker-walk", "cheetah-run"];

    #[test]
    fn counts_edits() {
        let chars = |text: &str| text.chars().collect::<Vec<_>>();
        for (a, b, expected) in [
            ("", "", 0),
            ("abc", "", 3),
            ("abc", "abd", 1),
            ("abc", "acb", 1),
            ("kitten", "sitting", 3),
        ] {
            assert_eq!(distance(&chars(a), &chars(b)), expected, "{a} {b}");
            assert_eq!(distance(&chars(b), &chars(a)), expected, "{b} {a}");
        }
    }

    #[test]
    fn finds_typos_parts_and_other_spellings() {
        assert_eq!(nearest("cartpole_swing_up", NAMES), ["cartpole-swingup"]);
        assert_eq!(nearest("Walker-Wlak", NAMES), ["walker-walk"]);
        assert_eq!(nearest("pixels", NAMES), ["falling-pixels"]);
        assert!(nearest("humanoid-stand", NAMES).is_empty());
        assert!(nearest("", NAMES).is_empty());
    }

    #[test]
    fn puts_the_nearest_first() {
        assert_eq!(nearest("seeds", ["seed_two", "seed", "seats"]), ["seed", "seats"]);
    }
}
