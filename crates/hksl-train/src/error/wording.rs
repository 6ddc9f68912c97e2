//! Parts of messages.

use std::fmt;

use crate::config::Difference;

pub(super) fn listed(differences: &[Difference]) -> String {
    let one = |d: &Difference| format!("{} is {} there, not {}", d.key, d.saved, d.requested);
    differences.iter().map(one).collect::<Vec<_>>().join(", ")
}

pub(super) fn steps_there(steps: &[u64]) -> String {
    match steps {
        [] => "the run has none yet".to_owned(),
        steps => {
            let steps: Vec<_> = steps.iter().map(u64::to_string).collect();
            format!("there are {}", steps.join(", "))
        }
    }
}

pub(super) fn gigabytes(bytes: u64) -> String {
    format!("{:.1} GB", bytes as f64 / 1e9)
}

pub(super) fn ways_out(needed: u64, available: u64, replay: u64) -> &'static str {
    if needed - replay.min(needed) <= available {
        "--set replay.storage=file keeps the replay in files, for the same results; replay.capacity makes it smaller"
    } else {
        "--set sac.batch_size=… makes a learning step smaller, replay.storage=file keeps the replay in files"
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
