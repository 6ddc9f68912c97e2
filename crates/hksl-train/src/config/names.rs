//! "Did you mean …" for keys and names.

use hksl_envs::nearest;

use super::error::Error;

use super::Origin;
use super::schema::RULES;

/// How many keys are suggested at most.
const SUGGESTIONS: usize = 3;

/// The valid keys nearest to one that is not: nearest as a whole, or with the same or a similar last
/// part, so that `batch_size` finds `sac.batch_size`.
pub(super) fn nearest_keys(key: &str) -> Vec<String> {
    let keys = || RULES.iter().map(|(known, _)| *known);
    let wanted = last_part(key);
    let mut found: Vec<&str> = keys().filter(|known| last_part(known) == wanted).collect();
    found.extend(nearest(key, keys()));
    let near_parts = nearest(wanted, keys().map(last_part));
    found.extend(
        near_parts.iter().flat_map(|part| keys().filter(|known| last_part(known) == *part)),
    );
    let mut unique: Vec<String> = Vec::new();
    for known in found {
        if !unique.iter().any(|earlier| earlier == known) {
            unique.push(known.to_owned());
        }
    }
    unique.truncate(SUGGESTIONS);
    unique
}

/// An unknown task, method, preset or ablation, with its nearest and all valid names.
pub(super) fn unknown(kind: &'static str, name: &str, origin: Origin, valid: &[&str]) -> Error {
    let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    Error::UnknownName {
        kind,
        name: name.to_owned(),
        origin,
        nearest: owned(&nearest(name, valid.iter().copied())),
        valid: owned(valid),
    }
}

fn last_part(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suggests_by_last_part_and_by_spelling() {
        assert_eq!(nearest_keys("batch_size")[0], "sac.batch_size");
        assert_eq!(nearest_keys("sac.bacth_size")[0], "sac.batch_size");
        assert_eq!(nearest_keys("hksl.skip")[0], "hksl.skips");
        let rates = nearest_keys("learning_rate");
        assert!(rates.contains(&"sac.learning_rate".to_owned()), "{rates:?}");
        assert!(rates.contains(&"hksl.learning_rate".to_owned()), "{rates:?}");
        assert_eq!(nearest_keys("environment_step")[0], "environment_steps");
    }
}
