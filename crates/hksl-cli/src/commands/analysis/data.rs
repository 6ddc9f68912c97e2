//! Episodes for the analyses, collected or loaded from the cache.

use std::path::{Path, PathBuf};
use std::rc::Rc;

use candle_core::Device;
use hksl_core::rng;
use hksl_probe::cache::Cache;
use hksl_probe::episodes::{Episode, Policy, collect};
use hksl_train::config::Config;
use hksl_train::{COMMIT, Factories, Registry, device, native_facts};
use serde_json::{Value, json};

use super::Source;
use crate::progress::counter;

/// Data sets, each collected only once.
pub struct Data {
    cache: Option<Cache>,
    held: Vec<(Value, Rc<DataSet>)>,
    quiet: bool,
}

/// A set of episodes.
pub struct DataSet {
    /// Short fingerprint of the episodes.
    pub name: String,
    /// The episodes.
    pub episodes: Vec<Episode>,
}

/// The policy that plays the episodes.
pub enum Played<'a> {
    /// The uniform random policy.
    Random,
    /// The deterministic actions of a run's agent at this checkpoint.
    By(&'a Source, u64),
}

impl Data {
    /// Data sets cached in this folder or the user's cache folder; without either, nothing is cached.
    pub fn new(folder: Option<&Path>, quiet: bool) -> Self {
        let default = || dirs::cache_dir().map(|folder| folder.join("hksl"));
        let folder: Option<PathBuf> = folder.map(Path::to_owned).or_else(default);
        Self { cache: folder.map(|folder| Cache::new(&folder)), held: Vec::new(), quiet }
    }

    /// `count` episodes of a configuration's environment.
    pub fn episodes(
        &mut self,
        config: &Config,
        played: &Played,
        count: usize,
        seed: u64,
        device: &Device,
    ) -> anyhow::Result<Rc<DataSet>> {
        let description = describe(config, played, count, seed, device)?;
        if let Some((_, held)) = self.held.iter().find(|(of, _)| *of == description) {
            return Ok(held.clone());
        }
        let found = self.cache.as_ref().and_then(|cache| cache.load(&description));
        let episodes = match found {
            Some(episodes) => episodes,
            None => {
                let episodes = self.collect(config, played, count, seed, device)?;
                self.keep(&description, &episodes);
                episodes
            }
        };
        let name = Cache::fingerprint(&episodes)[..8].to_owned();
        let set = Rc::new(DataSet { name, episodes });
        self.held.push((description, set.clone()));
        Ok(set)
    }

    fn collect(
        &self,
        config: &Config,
        played: &Played,
        count: usize,
        seed: u64,
        device: &Device,
    ) -> anyhow::Result<Vec<Episode>> {
        let mut environment =
            Registry.environment(config, rng::stream(seed, "analysis episodes"))?;
        let mut policy = match played {
            Played::Random => Policy::Random(Box::new(rng::stream(seed, "analysis actions"))),
            Played::By(source, step) => Policy::Trained {
                agent: Box::new(source.agent(*step, device)?),
                frame_stack: source.config.environment.frame_stack,
            },
        };
        let bar = counter(self.quiet, count, format!("episodes of {}", config.task_label()));
        let episodes = collect(environment.as_mut(), &mut policy, count, &mut |done| {
            bar.set_position(done as u64);
        })?;
        bar.finish_and_clear();
        Ok(episodes)
    }

    /// Stores episodes in the cache. A cache that cannot be written is reported, but is not an error.
    fn keep(&self, description: &Value, episodes: &[Episode]) {
        let Some(cache) = &self.cache else { return };
        if let Err(error) = cache.store(description, episodes)
            && !self.quiet
        {
            let said = crate::exit::describe(&error.into()).replacen("error", "note", 1);
            crate::standard::error_line(&said);
        }
    }
}

/// Identifies the build that collects: in a checkout, the sources may differ from the commit.
fn program() -> String {
    let built = || std::env::current_exe()?.metadata()?.modified();
    match built() {
        Ok(built) if COMMIT != "unknown" => format!("{COMMIT}, built {built:?}"),
        _ => COMMIT.to_owned(),
    }
}

/// Everything that the episodes depend on.
fn describe(
    config: &Config,
    played: &Played,
    count: usize,
    seed: u64,
    on: &Device,
) -> anyhow::Result<Value> {
    let policy = match played {
        Played::Random => json!("random"),
        Played::By(source, step) => json!({
            "weights": source.weights_sha256(*step)?,
            "frame_stack": source.config.environment.frame_stack,
            // Rounding differs between devices, and so do episodes.
            "device": device::name(on),
        }),
    };
    let environment = &config.environment;
    Ok(json!({
        "hksl": env!("CARGO_PKG_VERSION"),
        "commit": program(),
        "task": config.task,
        "distraction": format!("{:?}", config.distraction()),
        "action_repeat": environment.action_repeat,
        "height": environment.height,
        "width": environment.width,
        "border": environment.border,
        "episode_steps": environment.episode_steps,
        "render": format!("{:?}", config.render_settings()),
        "native": native_facts(config),
        "policy": policy,
        "episodes": count,
        "seed": seed,
    }))
}
