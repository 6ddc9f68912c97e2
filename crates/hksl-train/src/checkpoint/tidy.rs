//! Removal of old checkpoints.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::{Checkpoints, Damage, Listing, STATE, SUMMARY, Summary, is_step, retention};
use crate::Result;

impl Checkpoints {
    /// Removes old states, weights and episodes.
    pub(super) fn tidy(&mut self) -> Result<()> {
        let all = match self.list_surely() {
            // The save is complete; the removal can wait.
            Err(error) if error.is_unread() => {
                tracing::warn!("old checkpoints were not removed: {error}");
                return Ok(());
            }
            listed => listed?.sound,
        };
        let plan = retention::plan(&all, &self.with_state(&all)?);
        for step in plan.states {
            self.files.put_away(&self.folder(step).join(STATE))?;
        }
        for step in plan.whole {
            self.files.put_away(&self.folder(step))?;
        }
        for (step, reasons) in plan.reasons {
            let path = self.folder(step).join(SUMMARY);
            let summary = Summary { reasons, ..all[&step].clone() };
            self.files.write_whole(&path, &summary.to_bytes(&path)?)?;
        }
        self.forget_unneeded_episodes()
    }

    /// Removes what interrupted saves have left.
    pub(super) fn clean(&self) -> Result<()> {
        self.files.clean(&self.checkpoints)?;
        for folder in hksl_files::entries(&self.checkpoints)? {
            if is_step(&folder) && folder.is_dir() {
                self.files.clean(&folder)?;
            }
        }
        Ok(())
    }

    /// Forgets episodes that no state needs.
    fn forget_unneeded_episodes(&mut self) -> Result<()> {
        let Listing { sound, damaged } = self.list()?;
        let states = self.with_state(&sound)?;
        // What a damaged state needs is not known; one that is older than two sound ones has had its time.
        let older = states.iter().rev().nth(1).map_or(PathBuf::new(), |&step| self.folder(step));
        let kept = |damage: &Damage| damage.folder > older && damage.folder.join(STATE).is_dir();
        if damaged.iter().any(kept) {
            return Ok(());
        }
        let needed: BTreeSet<u64> =
            states.iter().flat_map(|step| sound[step].episodes.keys().copied()).collect();
        let files: BTreeSet<PathBuf> = needed.iter().map(|&n| self.episode_file(n)).collect();
        for path in hksl_files::entries(&self.replay)?.iter().filter(|path| !files.contains(*path))
        {
            self.files.remove(path)?;
        }
        self.recorded.retain(|number, _| needed.contains(number));
        Ok(())
    }
}
