//! Grouping of runs by method.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use hksl_train::config::Config;

use super::Probed;

/// Removes paths that lead to the same folder.
pub fn unique_runs(paths: &[PathBuf]) -> Vec<&Path> {
    let mut seen = BTreeSet::new();
    let first =
        |path: &&PathBuf| seen.insert(path.canonicalize().unwrap_or_else(|_| path.to_path_buf()));
    paths.iter().filter(first).map(PathBuf::as_path).collect()
}

/// Warnings about runs that are pooled as seeds of one method but differ in other settings.
pub fn unlike(probed: &[Probed]) -> anyhow::Result<BTreeSet<String>> {
    let mut said = BTreeSet::new();
    for (index, of) in probed.iter().enumerate() {
        let config = &of.source.config;
        let pooled = |first: &&Probed| {
            let other = &first.source.config;
            (&first.label, &other.task, &other.distractor)
                == (&of.label, &config.task, &config.distractor)
        };
        let Some(first) = probed[..index].iter().find(pooled) else { continue };
        let (known, settings) = (first.source.config.settings()?, config.settings()?);
        let keys: Vec<&str> = known.unlike(&settings).collect();
        if !keys.is_empty() {
            said.insert(format!(
                "the runs {} of {} do not have the same settings ({}), but are pooled in figures",
                of.label,
                config.task_label(),
                keys.join(", ")
            ));
        }
    }
    Ok(said)
}

/// Labels runs by their folders if their label, task and seed are not unique.
pub fn tell_apart(probed: &mut [Probed]) {
    let key = |of: &Probed| {
        let Config { task, distractor, seed, .. } = &of.source.config;
        (of.label.clone(), task.clone(), distractor.clone(), *seed)
    };
    let keys: Vec<_> = probed.iter().map(key).collect();
    for (index, of) in probed.iter_mut().enumerate() {
        if keys.iter().filter(|other| **other == keys[index]).count() > 1 {
            of.label = of.source.folder.path().display().to_string();
        }
    }
}
