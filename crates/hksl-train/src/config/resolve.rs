//! From names, files and options to one checked configuration.

use std::path::PathBuf;

use hksl_sac::Ablation;
use hksl_sac::config::HkslConfig;
use toml::{Table, Value};

use hksl_files::numbers;

use super::error::{Error, Result};

use super::layer::{Merged, flatten};
use super::own_task::OwnTask;
use super::{
    ABLATION_NONE, Config, DistractorsConfig, Origin, Origins, PRESET_PAPER, labels, methods,
    names, schema, shipped,
};

/// What is asked for; everything may be left out.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// The task; else the user's layers decide, else `default.toml`.
    pub task: Option<String>,
    /// A task that is not in the registry, instead of one that is.
    pub own_task: Option<OwnTask>,
    /// The method; likewise.
    pub method: Option<String>,
    /// The ablation; likewise.
    pub ablation: Option<String>,
    /// The distractor; likewise.
    pub distractor: Option<String>,
    /// Presets in order; none stands for `paper`.
    pub presets: Vec<String>,
    /// The user's file.
    pub file: Option<PathBuf>,
    /// The `KEY=VALUE` of each `--set`, in order.
    pub sets: Vec<String>,
    /// Values by dotted key, as programs state them; they come after `sets`.
    pub values: Vec<(String, Value)>,
    /// Flags that stand for one key each.
    pub flags: Vec<Flag>,
}

/// A flag of the command line that stands for one key.
#[derive(Debug, Clone, PartialEq)]
pub struct Flag {
    /// The key, dotted.
    pub key: &'static str,
    /// Its value.
    pub value: Value,
    /// The flag's name, as in `--seed`.
    pub name: &'static str,
}

/// A checked configuration that knows where each value comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Resolved {
    /// The configuration.
    pub config: Config,
    /// Where each value comes from, by dotted key.
    pub origins: Origins,
    /// The presets in force, in order.
    pub presets: Vec<String>,
}

/// Merges all layers and checks the result.
///
/// # Errors
/// One [`Error`] for the first fault found: an unknown task, method, distractor, preset, ablation or key, a value
/// of the wrong type or out of range, a file that cannot be read. Each names the value, the layer
/// it stands in and what would be valid.
pub fn resolve(request: &Request) -> Result<Resolved> {
    let file = user_file(request)?;
    let user = user_layers(request, file.clone())?;
    let mut merged = Merged::empty();
    merged.add_text(shipped::default(), &Origin::Default)?;
    let select = |key| user.text(key).or_else(|| merged.text(key)).unwrap_or_else(unselected);
    let (method, ablation) = (select("method"), select("ablation"));
    let distractor = select("distractor");
    let task = match &request.own_task {
        Some(own) => (own.name.clone(), Origin::Environment),
        None => select("task"),
    };

    let defaults = merged.clone();
    let text = known("method", &method, shipped::method, &shipped::methods())?;
    let of_method = Origin::Method(method.0.clone());
    let by_task = merged.add_method(text, &of_method)?;
    match &request.own_task {
        Some(own) => own.add_to(&mut merged, &user)?,
        None => {
            let text = known("task", &task, shipped::task, &shipped::tasks())?;
            merged.add_text(text, &Origin::Task(task.0.clone()))?;
        }
    }
    if let Some(of_task) = by_task.get(&task.0) {
        merged.add_table("", of_task.clone(), &of_method)?;
    }
    let text = known("distractor", &distractor, shipped::distractor, &shipped::distractors())?;
    merged.add_text(text, &Origin::Distractor(distractor.0.clone()))?;
    let presets = match request.presets.as_slice() {
        [] => vec![PRESET_PAPER.to_owned()],
        presets => presets.to_vec(),
    };
    for preset in &presets {
        let asked = (preset.clone(), Origin::Flag("--preset"));
        let text = known("preset", &asked, shipped::preset, &shipped::presets())?;
        if let Some(owner) = shipped::preset_owner(preset).filter(|owner| *owner != method.0) {
            let (preset, method) = (preset.clone(), method.0);
            return Err(Error::ForeignPreset { preset, owner, method });
        }
        merged.add_text(text, &Origin::Preset(preset.clone()))?;
    }
    if methods::find(&method.0).is_some_and(|method| method.has_ablations) {
        apply_ablation(&mut merged, &ablation, &task.0)?;
    } else if ablation.0 != ABLATION_NONE {
        let (name, origin) = ablation;
        return Err(Error::Ablation {
            reason: format!(
                "`{name}` applies only to method hksl, but the method is {}; leave it out or use --method hksl",
                method.0
            ),
            name,
            origin,
        });
    }
    merged.reset_foreign(&defaults, &method.0);
    merged.refuse_foreign(&user, &method.0)?;
    labels::file_agrees(&merged, &file, &task.0, &ablation, &distractor)?;
    labels::sets_have_effect(&merged, &user, (&task.0, &method.0), &distractor.0)?;
    merged.overlay(user);

    if let Some(own) = &request.own_task {
        own.check(&merged)?;
    }
    let (config, mut origins) = merged.finish()?;
    labels::ablation_holds(&config, &origins)?;
    origins.retain(|key, _| !schema::is_foreign(key, &config.method));
    config.device_choice()?.require_compiled(&config.device, origins.get("device"))?;
    Ok(Resolved { config, origins, presets })
}

/// The same run with another distractor, as its file has it; `dynamic` stays.
///
/// # Errors
/// An unknown distractor; one for a task that has none.
pub fn with_distractor(config: &Config, name: &str) -> Result<Config> {
    let asked = (name.to_owned(), Origin::Flag("--distractor"));
    let text = known("distractor", &asked, shipped::distractor, &shipped::distractors())?;
    let mut merged = Merged::empty();
    merged.add_text(shipped::default(), &Origin::Default)?;
    merged.add_text(text, &Origin::Distractor(name.to_owned()))?;
    let mut distractors: DistractorsConfig = merged.section("distractors")?;
    distractors.dynamic = config.distractors.dynamic;
    let config = Config { distractor: name.to_owned(), distractors, ..config.clone() };
    config.validate()?;
    Ok(config)
}

fn user_file(request: &Request) -> Result<Merged> {
    let mut file = Merged::empty();
    if let Some(path) = &request.file {
        let text = hksl_files::text::read(path)
            .map_err(|source| Error::ReadConfig { path: path.clone(), source })?;
        file.add_text(&text, &Origin::File(path.clone()))?;
    }
    Ok(file)
}

/// File, `--set` and flags, in this order.
fn user_layers(request: &Request, file: Merged) -> Result<Merged> {
    let mut user = file;
    for text in &request.sets {
        let (key, value) = parse_set(text)?;
        user.add(key, value, &Origin::Set)?;
    }
    for (key, value) in &request.values {
        user.add(key, value.clone(), &Origin::Program)?;
    }
    for (key, value, name) in [
        ("task", &request.task, "TASK"),
        ("method", &request.method, "--method"),
        ("ablation", &request.ablation, "--ablation"),
        ("distractor", &request.distractor, "--distractor"),
    ] {
        if let Some(value) = value {
            user.add(key, Value::String(value.clone()), &Origin::Flag(name))?;
        }
    }
    for flag in &request.flags {
        user.add(flag.key, flag.value.clone(), &Origin::Flag(flag.name))?;
    }
    Ok(user)
}

/// Reads `KEY=VALUE`. The value is TOML; what is none, is a number as people type it, `.001`, or a string: `device=cuda:1`.
fn parse_set(text: &str) -> Result<(&str, Value)> {
    let refused = |reason| Error::SetSyntax { text: text.to_owned(), reason };
    let (key, value) = text.split_once('=').ok_or_else(|| refused("there is no `=`"))?;
    let (key, value) = (key.trim(), value.trim());
    if key.is_empty() {
        return Err(refused("there is no key before `=`"));
    }
    if value.is_empty() {
        return Err(refused("there is no value after `=`"));
    }
    Ok((key, value.parse().unwrap_or_else(|_| no_toml(value))))
}

fn no_toml(text: &str) -> Value {
    let whole = numbers::whole(text).and_then(|whole| i64::try_from(whole).ok());
    whole
        .map(Value::Integer)
        .or_else(|| numbers::number(text).map(Value::Float))
        .unwrap_or_else(|| Value::String(text.to_owned()))
}

/// `default.toml` states all selectors; without one, the empty name is refused by name.
fn unselected() -> (String, Origin) {
    (String::new(), Origin::Default)
}

fn known(
    kind: &'static str,
    (name, origin): &(String, Origin),
    find: fn(&str) -> Option<&'static str>,
    valid: &[&str],
) -> Result<&'static str> {
    find(name).ok_or_else(|| names::unknown(kind, name, origin.clone(), valid))
}

/// Puts what the ablation changes on top.
fn apply_ablation(
    merged: &mut Merged,
    (name, origin): &(String, Origin),
    task: &str,
) -> Result<()> {
    let refused = |reason| Error::Ablation { name: name.clone(), origin: origin.clone(), reason };
    let ablation = Ablation::from_name(name, shipped::varies_levels(task));
    let ablation = ablation.map_err(|error| match error {
        hksl_sac::Error::UnknownAblation { valid, .. } => {
            names::unknown("ablation", name, origin.clone(), &valid)
        }
        hksl_sac::Error::AblationNotForTask { .. } => refused(format!(
            "`{name}` is defined for {} alone; for {task} state the levels' skips, as in --set hksl.skips=[1,3,5]",
            shipped::tasks_of_varied_levels().join(", ")
        )),
        error => refused(error.to_string()),
    })?;
    let mut hksl: HkslConfig = merged.section("hksl")?;
    ablation.apply(&mut hksl);
    let table = Table::try_from(&hksl).map_err(Error::NotToml)?;
    let changed = flatten(Table::from_iter([("hksl".to_owned(), Value::Table(table))]));
    merged.add_changes(changed, &Origin::Ablation(name.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_values_as_toml_and_else_as_words() {
        assert_eq!(parse_set("a=1").unwrap(), ("a", Value::Integer(1)));
        assert_eq!(parse_set("a.b = 1e-4").unwrap(), ("a.b", Value::Float(1e-4)));
        assert_eq!(parse_set("a=.001").unwrap(), ("a", Value::Float(0.001)));
        assert_eq!(parse_set("a=-.5").unwrap(), ("a", Value::Float(-0.5)));
        assert_eq!(parse_set("a=5.").unwrap(), ("a", Value::Integer(5)));
        assert_eq!(parse_set("a=007").unwrap(), ("a", Value::Integer(7)));
        assert_eq!(parse_set("a=100_000").unwrap(), ("a", Value::Integer(100_000)));
        assert_eq!(parse_set("a=true").unwrap(), ("a", Value::Boolean(true)));
        assert_eq!(parse_set("a=\"x = y\"").unwrap().1, Value::String("x = y".into()));
        assert_eq!(parse_set("a=cuda:1").unwrap().1, Value::String("cuda:1".into()));
        assert_eq!(parse_set("a=[1, 3]").unwrap().1, "[1, 3]".parse::<Value>().unwrap());
    }

    #[test]
    fn says_what_a_set_lacks() {
        for (text, word) in [("sac.batch_size", "no `=`"), ("=3", "no key"), ("seed=", "no value")]
        {
            let message = parse_set(text).unwrap_err().to_string();
            assert!(message.contains(word) && message.contains(text), "{message}");
        }
    }
}
