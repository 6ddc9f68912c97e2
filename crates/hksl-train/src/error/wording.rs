//! Parts of messages.

use std::fmt;

use crate::config::Difference;
use crate::memory::{LimitedBy, MemoryLimit};

pub(super) fn listed(differences: &[Difference]) -> String {
    let one = |d: &Difference| format!("{} is {} there, not {}", d.key, d.saved, d.requested);
    differences.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// Which steps there are; of many, the nearest to the one asked for.
pub(super) fn steps_there(asked: u64, steps: &[u64]) -> String {
    const MANY: usize = 6;
    let mut shown = steps.to_vec();
    shown.sort_by_key(|step| step.abs_diff(asked));
    shown.truncate(MANY);
    shown.sort_unstable();
    let list = shown.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
    match steps.len() {
        0 => "the run has none yet".to_owned(),
        count if count <= MANY => format!("there are {list}"),
        count => format!("there are {count}, the nearest {list}"),
    }
}

/// Gigabytes, or megabytes where that is less than one.
pub(super) fn gigabytes(bytes: u64) -> String {
    match bytes {
        ..1_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

/// Which limit decides what is free.
pub(super) fn under(limit: Option<&MemoryLimit>) -> String {
    limit.map_or_else(String::new, |MemoryLimit { bytes, by }| {
        format!(" under {by}, {} in all", gigabytes(*bytes))
    })
}

pub(super) fn ways_out(
    needed: u64,
    available: u64,
    replay: u64,
    limit: Option<&MemoryLimit>,
) -> String {
    let files_count = limit.is_some_and(|limit| limit.by == LimitedBy::AddressSpace);
    let way = match needed - replay.min(needed) <= available {
        true if files_count => "--set replay.capacity=… makes the replay smaller",
        true => {
            "--set replay.storage=file keeps the replay in files, for the same results; replay.capacity makes it smaller"
        }
        false if files_count => "--set sac.batch_size=… makes a learning step smaller",
        false => {
            "--set sac.batch_size=… makes a learning step smaller, replay.storage=file keeps the replay in files"
        }
    };
    match limit {
        Some(limit) => format!("raise {}; {way}", limit.by),
        None => way.to_owned(),
    }
}

pub(super) fn did_you_mean(nearest: &[String]) -> String {
    match nearest {
        [] => String::new(),
        [one] => format!("; did you mean `{one}`?"),
        [several @ .., last] => {
            let several: Vec<_> = several.iter().map(|name| format!("`{name}`")).collect();
            format!("; did you mean {} or `{last}`?", several.join(", "))
        }
    }
}

pub(super) fn all_names(kind: &str, nearest: &[String], valid: &[String]) -> String {
    let valid = valid.join(", ");
    match nearest {
        [] => format!("; the {kind}s are {valid}"),
        nearest => format!("{} The {kind}s are {valid}", did_you_mean(nearest)),
    }
}

pub(super) fn in_brackets(origin: Option<&impl fmt::Display>) -> String {
    origin.map(|origin| format!(" ({origin})")).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_steps_the_nearest_are_named() {
        let steps: Vec<u64> = (0..11).map(|index| 10_000 * index).collect();
        assert_eq!(steps_there(5, &[]), "the run has none yet");
        assert_eq!(steps_there(5, &steps[..2]), "there are 0, 10000");
        let text = steps_there(77_777, &steps);
        assert_eq!(text, "there are 11, the nearest 50000, 60000, 70000, 80000, 90000, 100000");
    }
}
