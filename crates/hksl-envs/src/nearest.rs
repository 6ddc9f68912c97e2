//! Suggestions for mistyped names.

/// Returns up to three `candidates` similar to `name`, the most similar first.
///
/// The distance is the number of insertions, deletions, substitutions and transpositions (Damerau–Levenshtein), ignoring
/// case and the difference of `-` and `_`. A candidate is similar if the distance is at most a third of the longer length
/// (at least 2), or if one name contains the other.
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
            let distance = strsim::osa_distance(&wanted, &other);
            let longer = wanted.chars().count().max(other.chars().count());
            let limit = (longer / 3).max(2);
            let within = !wanted.is_empty()
                && !other.is_empty()
                && (other.contains(&wanted) || wanted.contains(&other));
            (distance <= limit || within).then_some((distance, candidate))
        })
        .collect();
    ranked.sort();
    ranked.into_iter().take(3).map(|(_, candidate)| candidate).collect()
}

/// Normalises case and dashes.
fn plain(name: &str) -> String {
    name.to_lowercase().replace('_', "-")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 4] = ["falling-pixels", "cartpole-swingup", "walker-walk", "cheetah-run"];

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
