//! Saves that fail, files that are damaged: what was there before must be there after.

use std::cell::Cell;
use std::fs;
use std::io;
use std::rc::Rc;

use candle_core::{Device, Tensor};
use hksl_sac::AgentRest;

use hksl_files::disk::{Disk, FileSystem};

use super::*;

const LAYOUT: Layout = Layout { frame: [1, 1, 2], stack: 3, action_dims: 1 };

/// What a faulty disk does in the operation that fails.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// Nothing is written, as when the disk is full.
    Full,
    /// Half is written, and said so.
    Short,
    /// Half is written, and nothing said.
    Silent,
    /// Nothing can be forced to the disk.
    Sync,
    /// Nothing can be renamed.
    Rename,
    /// Nothing can be removed.
    Remove,
}

/// A file system that fails in its `left`-th operation of a kind, and in all after it.
#[derive(Debug)]
struct Faulty {
    fault: Fault,
    left: Rc<Cell<usize>>,
}

impl Faulty {
    fn fails(&self, kinds: &[Fault]) -> io::Result<()> {
        if !kinds.contains(&self.fault) {
            return Ok(());
        }
        match self.left.get() {
            0 => Err(io::Error::from(io::ErrorKind::StorageFull)),
            left => {
                self.left.set(left - 1);
                Ok(())
            }
        }
    }
}

impl Disk for Faulty {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let outcome = self.fails(&[Fault::Full, Fault::Short, Fault::Silent]);
        if outcome.is_err() && self.fault != Fault::Full {
            FileSystem.write(path, &bytes[..bytes.len() / 2])?;
        }
        if self.fault == Fault::Silent && outcome.is_err() {
            return Ok(());
        }
        outcome?;
        FileSystem.write(path, bytes)
    }
    fn sync(&self, path: &Path) -> io::Result<()> {
        self.fails(&[Fault::Sync])?;
        FileSystem.sync(path)
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.fails(&[Fault::Rename])?;
        FileSystem.rename(from, to)
    }
    fn create_folder(&self, path: &Path) -> io::Result<()> {
        self.fails(&[Fault::Full])?;
        FileSystem.create_folder(path)
    }
    fn remove(&self, path: &Path) -> io::Result<()> {
        self.fails(&[Fault::Remove])?;
        FileSystem.remove(path)
    }
}

fn replay(episodes: u8) -> Replay {
    let mut replay = Replay::new(LAYOUT, 100);
    for episode in 0..=episodes {
        replay.begin_episode(&[episode, 0]).unwrap();
        for time in 1..=5 {
            replay.push(&[0.5], f32::from(time), false, &[episode, time]).unwrap();
        }
        if episode < episodes {
            replay.end_episode();
        }
    }
    replay
}

/// Saves a state that says its step everywhere.
fn save(checkpoints: &mut Checkpoints, step: u64) -> Result<()> {
    let tensor = Tensor::full(step as f32, 3, &Device::Cpu).unwrap();
    let tensors = BTreeMap::from([("weights.w".to_owned(), tensor)]);
    let streams = BTreeMap::from([("act".to_owned(), hksl_core::rng::stream(step, "act"))]);
    checkpoints.save(&Content {
        agent: AgentState { tensors, rest: AgentRest { streams } },
        replay: &replay((step / 10) as u8),
        run: &run(step),
        stack: vec![Array3::from_elem((1, 1, 2), step as u8); 3],
        memory: RecurrentState::default(),
        reasons: BTreeSet::new(),
    })
}

fn run(step: u64) -> RunState {
    RunState {
        agent_step: step,
        environment_step: step,
        updates: step,
        episode_return: 0.5,
        metrics_bytes: step,
        wall_seconds: 1.5,
        ..RunState::default()
    }
}

/// The step of the state to go on from, which must be that of every part.
fn loaded(folder: &Path) -> Result<u64> {
    let loaded = Checkpoints::new(folder).load_newest(&LAYOUT, ReplayStorage::Memory)?;
    let saved = loaded.0.expect("a state");
    let step = saved.run.environment_step;
    assert_eq!(saved.run, run(step));
    assert_eq!(saved.agent.tensors["weights.w"].to_vec1::<f32>().unwrap(), [step as f32; 3]);
    assert_eq!(saved.stack[2], Array3::from_elem((1, 1, 2), step as u8));
    let expected = replay((step / 10) as u8);
    assert!(saved.finished.iter().eq(expected.finished().map(|episode| &**episode)));
    assert_eq!(saved.running.as_ref(), expected.running());
    Ok(step)
}

#[test]
fn whatever_fails_in_a_save_the_state_before_it_or_its_own_is_there() {
    for fault in
        [Fault::Full, Fault::Short, Fault::Silent, Fault::Sync, Fault::Rename, Fault::Remove]
    {
        let mut failures = 0;
        for operation in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let mut sound = Checkpoints::new(folder.path());
            for step in [10, 20, 30] {
                save(&mut sound, step).unwrap();
            }
            let left = Rc::new(Cell::new(operation));
            let disk = Faulty { fault, left: Rc::clone(&left) };
            let mut faulty = Checkpoints::with(folder.path(), Files::on(Box::new(disk)));
            let (_, skipped) = faulty.load_newest(&LAYOUT, ReplayStorage::Memory).unwrap();
            assert!(skipped.is_empty());
            let outcome = save(&mut faulty, 40);
            let step = loaded(folder.path()).unwrap();
            assert!(step == 30 || step == 40, "{fault:?} in operation {operation}: {step}");
            assert!(outcome.is_err() || fault == Fault::Silent || step == 40);
            // And what comes next is as if nothing had been.
            let mut sound = Checkpoints::new(folder.path());
            let (_, skipped) = sound.load_newest(&LAYOUT, ReplayStorage::Memory).unwrap();
            for damage in skipped {
                sound.set_aside(&damage).unwrap();
            }
            save(&mut sound, 50).unwrap();
            assert_eq!(loaded(folder.path()).unwrap(), 50);
            if left.get() > 0 {
                break;
            }
            failures += 1;
        }
        assert!(failures >= 3, "{fault:?} was tried {failures} times");
    }
}

/// A save over one of the same step, as pretraining makes many: the old one or the new one is there, whatever fails.
#[test]
fn whatever_fails_in_a_save_over_another_one_of_them_is_there() {
    for fault in [Fault::Full, Fault::Sync, Fault::Rename, Fault::Remove] {
        for operation in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let mut sound = Checkpoints::new(folder.path());
            save(&mut sound, 10).unwrap();
            let left = Rc::new(Cell::new(operation));
            let disk = Faulty { fault, left: Rc::clone(&left) };
            let mut faulty = Checkpoints::with(folder.path(), Files::on(Box::new(disk)));
            faulty.load_newest(&LAYOUT, ReplayStorage::Memory).unwrap();
            let outcome = save(&mut faulty, 10);
            assert_eq!(loaded(folder.path()).unwrap(), 10, "{fault:?} in operation {operation}");
            let mut sound = Checkpoints::new(folder.path());
            sound.load_newest(&LAYOUT, ReplayStorage::Memory).unwrap();
            save(&mut sound, 20).unwrap();
            assert_eq!(sound.list().unwrap().sound.keys().collect::<Vec<_>>(), [&10, &20]);
            if outcome.is_ok() {
                assert!(operation > 0);
                break;
            }
        }
    }
}

/// Every file of a run's checkpoints and replay.
fn all_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for path in hksl_files::entries(folder).unwrap() {
        if path.is_dir() {
            found.extend(all_files(&path));
        } else {
            found.push(path);
        }
    }
    found
}

/// A run whose states at 20 and 30 share the episodes that are older.
fn two_states() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut checkpoints = Checkpoints::new(folder.path());
    for step in [20, 30] {
        save(&mut checkpoints, step).unwrap();
    }
    folder
}

#[test]
fn damage_of_every_kind_in_every_file_is_noticed() {
    type Harm = fn(&mut Vec<u8>);
    let harms: [Harm; 4] = [
        |bytes| bytes.truncate(bytes.len() / 2),
        |bytes| {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
        },
        |bytes| bytes.clear(),
        |bytes| *bytes = b"\x10\0\0\0\0\0\0\0{\"__metadata__\":{}".to_vec(),
    ];
    let count = all_files(two_states().path()).len();
    assert_eq!(count, 15);
    for index in 0..count {
        for harm in harms {
            let folder = two_states();
            let path = all_files(folder.path())[index].clone();
            let mut bytes = fs::read(&path).unwrap();
            harm(&mut bytes);
            fs::write(&path, &bytes).unwrap();
            let before = all_files(folder.path());
            let name = path.strip_prefix(folder.path()).unwrap().display().to_string();
            // Both states need the two oldest episodes.
            match loaded(folder.path()) {
                Ok(step) if name.contains("step-000000030") => assert_eq!(step, 20, "{name}"),
                Ok(step) if name.contains("step-000000020") => assert_eq!(step, 30, "{name}"),
                Ok(step) => assert!(step == 20 && name.ends_with("002.safetensors"), "{name}"),
                Err(error) => {
                    assert!(name.starts_with("replay"), "{name}: {error}");
                    assert!(error.to_string().contains(hksl_files::name(&path)), "{error}");
                }
            }
            assert_eq!(all_files(folder.path()), before, "nothing is deleted");
        }
    }
}

#[test]
fn a_file_that_is_gone_is_named() {
    let folder = two_states();
    fs::remove_file(Checkpoints::new(folder.path()).episode_file(0)).unwrap();
    let message = loaded(folder.path()).unwrap_err().to_string();
    assert!(message.starts_with("cannot read"), "{message}");
    assert!(message.ends_with("episode-000000000.safetensors"), "{message}");
}

/// As on a network disk that does not answer for a while.
#[test]
fn what_cannot_be_read_now_is_not_taken_for_damage() {
    for name in [AGENT, SUMMARY] {
        let folder = two_states();
        let file = folder.path().join("checkpoints/step-000000030").join(name);
        // A folder in its place stands for what is there and cannot be read.
        fs::remove_file(&file).unwrap();
        fs::create_dir(&file).unwrap();
        let before = all_files(folder.path());
        let error = loaded(folder.path()).unwrap_err();
        assert!(matches!(error, crate::Error::Files(hksl_files::Error::Read { .. })), "{error}");
        assert_eq!(all_files(folder.path()), before);
    }
}

#[test]
fn episodes_of_a_state_that_cannot_be_listed_are_kept() {
    let folder = two_states();
    let mut checkpoints = Checkpoints::new(folder.path());
    checkpoints.load_newest(&LAYOUT, ReplayStorage::Memory).unwrap();
    let needed_by_none = checkpoints.episode_file(99);
    fs::write(&needed_by_none, "").unwrap();
    let summary = folder.path().join("checkpoints/step-000000020").join(SUMMARY);
    fs::write(&summary, "").unwrap();
    save(&mut checkpoints, 40).unwrap();
    // Two sound states are newer than the damaged one by then.
    assert!(!needed_by_none.exists());
    fs::write(&needed_by_none, "").unwrap();
    let newer = folder.path().join("checkpoints/step-000000040").join(SUMMARY);
    let text = fs::read(&newer).unwrap();
    fs::write(&newer, "").unwrap();
    save(&mut checkpoints, 50).unwrap();
    assert!(needed_by_none.is_file());
    fs::write(&newer, text).unwrap();
    save(&mut checkpoints, 60).unwrap();
    assert!(!needed_by_none.exists());
}

#[test]
fn what_interrupted_saves_have_left_goes_first() {
    let folder = two_states();
    let checkpoints = folder.path().join("checkpoints");
    let before = all_files(folder.path());
    // Somebody's archive beside them is none of ours.
    let archive = checkpoints.join("step-000000010.tar.gz");
    fs::write(&archive, "").unwrap();
    let before = [before, vec![archive]].concat();
    for left in [".new-step-000000040", "step-000000020/.gone-state", ".old-step-000000030"] {
        fs::create_dir(checkpoints.join(left)).unwrap();
        fs::write(checkpoints.join(left).join("part"), "").unwrap();
    }
    assert_eq!(loaded(folder.path()).unwrap(), 30);
    let sorted = |files: Vec<PathBuf>| files.into_iter().collect::<BTreeSet<_>>();
    assert_eq!(sorted(all_files(folder.path())), sorted(before));
}

#[test]
fn another_version_is_told() {
    let folder = two_states();
    for step in ["step-000000020", "step-000000030"] {
        let path = folder.path().join("checkpoints").join(step).join(SUMMARY);
        let text = fs::read_to_string(&path).unwrap();
        let other = text.replace("\"format_version\": 2", "\"format_version\": 7");
        assert_ne!(text, other);
        fs::write(&path, other).unwrap();
    }
    let message = loaded(folder.path()).unwrap_err().to_string();
    assert!(message.contains("format version 7") && message.contains("version 2"), "{message}");
}

#[test]
fn a_damaged_checkpoint_is_set_aside_and_the_older_one_goes_on() {
    let folder = two_states();
    let mut checkpoints = Checkpoints::new(folder.path());
    let agent = folder.path().join("checkpoints/step-000000030").join(AGENT);
    fs::write(&agent, "nothing").unwrap();
    let (saved, skipped) = checkpoints.load_newest(&LAYOUT, ReplayStorage::File).unwrap();
    assert_eq!(saved.unwrap().run.environment_step, 20);
    assert_eq!(skipped.len(), 1);
    let moved = checkpoints.set_aside(&skipped[0]).unwrap();
    assert!(moved.ends_with("damaged-step-000000030") && moved.join(AGENT).is_file());
    // The file of episode 2 is one that the older state does not vouch for: it is written again.
    fs::write(checkpoints.episode_file(2), "another life's").unwrap();
    save(&mut checkpoints, 30).unwrap();
    assert_eq!(loaded(folder.path()).unwrap(), 30);
}

#[test]
fn weights_without_a_state_are_no_reason_to_begin_anew() {
    let folder = two_states();
    for step in ["step-000000020", "step-000000030"] {
        fs::remove_dir_all(folder.path().join("checkpoints").join(step).join(STATE)).unwrap();
    }
    let error = loaded(folder.path()).unwrap_err();
    assert!(matches!(error, crate::Error::Checkpoint(Error::NoState { .. })), "{error}");
}
