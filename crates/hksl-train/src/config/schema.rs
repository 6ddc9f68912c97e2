//! Which keys there are, of which type, and in which range.

use toml::Value;

use super::error::{Error, Result};

use super::Origin;
use super::device::MOST_THREADS;
use super::methods::{self, METHODS, Method};
use hksl_files::numbers::{number, rewritten, whole, whole_float};

/// The type and range of a key's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Rule {
    /// A string, checked elsewhere.
    Text,
    /// One of some words.
    Choice(&'static [&'static str]),
    /// `true` or `false`.
    Switch,
    /// An integer within bounds, both included.
    Integer(i64, i64),
    /// A list of integers within bounds, both included.
    Integers(i64, i64),
    /// A number within bounds, both included.
    Number(f64, f64),
    /// A number above the first bound, up to the second.
    NumberAbove(f64, f64),
}

use Rule::{Choice, Integer, Integers, Number, NumberAbove, Switch, Text};

/// Beyond any machine, yet far from overflow in products of two.
const MANY: i64 = 1_000_000_000;
/// For counts of steps over a whole run.
const STEPS: i64 = 1_000_000_000_000;

const INITIALISATIONS: &[&str] = &["uniform", "orthogonal", "delta-orthogonal"];

/// Every key, dotted. `configs/default.toml` states the same keys; a test compares the two.
pub(super) const RULES: &[(&str, Rule)] = &[
    ("task", Text),
    ("method", Text),
    ("ablation", Text),
    ("distractor", Text),
    ("seed", Integer(0, i64::MAX)),
    ("environment_steps", Integer(1, STEPS)),
    ("device", Text),
    ("threads", Integer(0, MOST_THREADS as i64)),
    ("environment.action_repeat", Integer(1, MANY)),
    ("environment.frame_stack", Integer(1, 1000)),
    ("environment.height", Integer(1, 65536)),
    ("environment.width", Integer(1, 65536)),
    ("environment.border", Integer(0, 1000)),
    ("environment.episode_steps", Integer(1, MANY)),
    ("distractors.dynamic", Switch),
    ("distractors.color.max_delta", Number(0.0, 1.0)),
    ("distractors.color.step_std", Number(0.0, 1.0)),
    ("distractors.camera.horizontal_delta", Number(0.0, 3.2)),
    ("distractors.camera.vertical_delta", Number(0.0, 3.2)),
    ("distractors.camera.roll_delta", Number(0.0, 3.2)),
    ("distractors.camera.velocity_std", Number(0.0, 10.0)),
    ("distractors.camera.max_velocity", Number(0.0, 10.0)),
    ("distractors.camera.roll_velocity_std", Number(0.0, 3.2)),
    ("distractors.camera.max_roll_velocity", Number(0.0, 3.2)),
    ("distractors.camera.max_zoom_in", Number(0.0, 0.99)),
    ("distractors.camera.max_zoom_out", Number(0.0, 10.0)),
    ("render.shadows", Switch),
    ("render.reflections", Switch),
    ("render.samples", Integer(0, 64)),
    ("render.shadow_map", Integer(1, 16384)),
    ("render.device", Text),
    ("training.initial_random_steps", Integer(0, STEPS)),
    ("replay.capacity", Integer(1, MANY)),
    ("replay.storage", Choice(&["memory", "file"])),
    ("augmentation.pad", Integer(0, 65536)),
    ("augmentation.shift_per", Choice(&["observation", "trajectory"])),
    ("encoder.filters", Integer(1, 65536)),
    ("encoder.latent_dims", Integer(1, 65536)),
    ("sac.batch_size", Integer(1, 1_000_000)),
    ("sac.learning_rate", NumberAbove(0.0, 1.0)),
    ("sac.discount", Number(0.0, 1.0)),
    ("sac.initial_temperature", NumberAbove(0.0, 1e6)),
    ("sac.hidden_units", Integer(1, 65536)),
    ("sac.log_std_minimum", Number(-100.0, 100.0)),
    ("sac.log_std_maximum", Number(-100.0, 100.0)),
    ("sac.target_update_every", Integer(1, STEPS)),
    ("sac.critic_tau", NumberAbove(0.0, 1.0)),
    ("sac.encoder_tau", NumberAbove(0.0, 1.0)),
    ("hksl.skips", Integers(1, MANY)),
    ("hksl.trajectory_length", Integer(1, MANY)),
    ("hksl.learning_rate", NumberAbove(0.0, 1.0)),
    ("hksl.actor_update_every", Integer(1, STEPS)),
    ("hksl.update_schedule", Choice(&["sequential", "joint"])),
    ("hksl.initialisation", Choice(INITIALISATIONS)),
    ("hksl.communication_hidden", Integer(1, 65536)),
    ("hksl.representation", Switch),
    ("hksl.communication", Switch),
    ("hksl.projection", Switch),
    ("hksl.shared_encoder", Switch),
    ("baseline.actor_update_every", Integer(1, STEPS)),
    ("baseline.initialisation", Choice(INITIALISATIONS)),
    ("drq.target_views", Integer(1, 1000)),
    ("drq.critic_views", Integer(1, 1000)),
    ("curl.double_encoder_step", Switch),
    ("pi_sac.learning_rate", NumberAbove(0.0, 1.0)),
    ("pi_sac.compression", Number(0.0, 1000.0)),
    ("pi_sac.smoothing", Number(0.0, 1000.0)),
    ("pi_sac.head_units", Integer(1, 65536)),
    ("pi_sac.backward_tau", NumberAbove(0.0, 1.0)),
    ("pi_sac.pretraining_steps", Integer(0, STEPS)),
    ("dbc.transition", Choice(&["deterministic", "probabilistic", "ensemble"])),
    ("dbc.ensemble_size", Integer(1, 1000)),
    ("dbc.model_units", Integer(1, 65536)),
    ("dbc.bisimulation_weight", Number(0.0, 1000.0)),
    ("dbc.model_l2", Number(0.0, 1.0)),
    ("dreamer.vision", Choice(&["shared", "original"])),
    ("dreamer.vision_depth", Integer(1, 65536)),
    ("dreamer.batch_sequences", Integer(1, 1_000_000)),
    ("dreamer.sequence_length", Integer(2, MANY)),
    ("dreamer.train_every", Integer(1, STEPS)),
    ("dreamer.pretraining_steps", Integer(0, STEPS)),
    ("dreamer.deterministic_units", Integer(1, 65536)),
    ("dreamer.hidden_units", Integer(1, 65536)),
    ("dreamer.variables", Integer(1, 65536)),
    ("dreamer.classes", Integer(2, 65536)),
    ("dreamer.reward_layers", Integer(0, 1000)),
    ("dreamer.reward_units", Integer(1, 65536)),
    ("dreamer.behaviour_layers", Integer(0, 1000)),
    ("dreamer.behaviour_units", Integer(1, 65536)),
    ("dreamer.world_learning_rate", NumberAbove(0.0, 1.0)),
    ("dreamer.actor_learning_rate", NumberAbove(0.0, 1.0)),
    ("dreamer.critic_learning_rate", NumberAbove(0.0, 1.0)),
    ("dreamer.epsilon", NumberAbove(0.0, 1.0)),
    ("dreamer.gradient_clip", NumberAbove(0.0, 1e9)),
    ("dreamer.weight_decay", Number(0.0, 1.0)),
    ("dreamer.kl_balance", Number(0.0, 1.0)),
    ("dreamer.free_nats", Number(0.0, 1e6)),
    ("dreamer.discount", Number(0.0, 1.0)),
    ("dreamer.lambda", Number(0.0, 1.0)),
    ("dreamer.horizon", Integer(2, 10_000)),
    ("dreamer.entropy_weight", Number(0.0, 1e6)),
    ("dreamer.slow_critic_every", Integer(1, STEPS)),
    ("evaluation.every_environment_steps", Integer(1, STEPS)),
    ("evaluation.episodes", Integer(1, 1_000_000)),
    ("evaluation.video", Switch),
    ("checkpoint.minutes", NumberAbove(0.0, 1e6)),
    ("checkpoint.weights_every_environment_steps", Integer(1, STEPS)),
    ("metrics.every_agent_steps", Integer(1, STEPS)),
    ("metrics.diagnostics_every_agent_steps", Integer(1, STEPS)),
    ("metrics.tensorboard", Switch),
];

/// The rule of a key, if there is such a key.
pub(super) fn rule(key: &str) -> Option<Rule> {
    RULES.iter().find(|(known, _)| *known == key).map(|(_, rule)| *rule)
}

/// The methods that read a key; none for a key that every method reads.
pub(super) fn owners(key: &str) -> Option<Vec<&'static str>> {
    let section = key.split('.').next()?;
    let reads = |method: &&Method| method.sections.contains(&section);
    let owners: Vec<_> = METHODS.iter().filter(reads).map(|method| method.name).collect();
    (!owners.is_empty()).then_some(owners)
}

/// Whether a method does not read a key.
pub(super) fn is_foreign(key: &str, method: &str) -> bool {
    owners(key).is_some_and(|methods| !methods.contains(&method))
}

/// The sections that this method has, but not all methods.
pub(super) fn own_sections(method: &str) -> Vec<&'static str> {
    methods::find(method).map_or(Vec::new(), |method| method.sections.to_vec())
}

/// Whether `path` is a table that holds keys.
pub(super) fn is_section(path: &str) -> bool {
    RULES.iter().any(|(key, _)| key.strip_prefix(path).is_some_and(|rest| rest.starts_with('.')))
}

/// Checks a value against its key's rule and returns it in the key's own type: an integer given
/// where a number is meant becomes one, and so does a whole number written as a float where an
/// integer is meant.
pub(super) fn check(key: &str, rule: Rule, value: Value, origin: &Origin) -> Result<Value> {
    let integer = |value: Value| match value.as_float().and_then(whole_float) {
        Some(whole) => Value::Integer(whole),
        None => value,
    };
    let value = match (rule, value) {
        (Number(..) | NumberAbove(..), Value::Integer(whole)) => Value::Float(whole as f64),
        (Integer(..), value) => integer(value),
        (Integers(..), Value::Array(items)) => {
            Value::Array(items.into_iter().map(integer).collect())
        }
        // The index of a device.
        (Text, Value::Integer(whole)) => Value::String(whole.to_string()),
        (_, value) => value,
    };
    let in_range = match (rule, &value) {
        (Text, Value::String(_)) | (Switch, Value::Boolean(_)) => true,
        (Choice(words), Value::String(word)) => words.contains(&word.as_str()),
        (Integer(least, most), Value::Integer(whole)) => (least..=most).contains(whole),
        (Integers(least, most), Value::Array(items)) => {
            if !items.iter().all(Value::is_integer) {
                return Err(wrong_type(key, &value, origin, rule));
            }
            let inside = |item: &Value| {
                item.as_integer().is_some_and(|whole| (least..=most).contains(&whole))
            };
            !items.is_empty() && items.iter().all(inside)
        }
        (Number(least, most), Value::Float(number)) => (least..=most).contains(number),
        (NumberAbove(bound, most), Value::Float(number)) => number > &bound && number <= &most,
        _ => return Err(wrong_type(key, &value, origin, rule)),
    };
    if in_range {
        return Ok(value);
    }
    Err(Error::OutOfRange {
        key: key.to_owned(),
        value: value.to_string(),
        origin: Some(origin.clone()),
        expected: format!("it must be {}", range(rule)),
    })
}

fn wrong_type(key: &str, value: &Value, origin: &Origin, rule: Rule) -> Error {
    let kind = match rule {
        Text => "a string",
        Choice(_) => "a word",
        Switch => "true or false",
        Integer(..) => "an integer",
        Integers(..) => "a list of integers, as in [1, 3]",
        Number(..) | NumberAbove(..) => "a number",
    };
    let hint = match (rule, value) {
        (Integer(..), Value::Float(number))
            if number.fract() == 0.0 && number.abs() < MANY as f64 * MANY as f64 =>
        {
            format!("; write {number:.0}")
        }
        (Switch, Value::String(text)) if text.to_lowercase().parse::<bool>().is_ok() => {
            format!("; write {} without quotes", text.to_lowercase())
        }
        (Integer(..), Value::String(text)) => match whole(text) {
            Some(number) => format!("; write {number} without quotes"),
            None => written(text),
        },
        (Number(..) | NumberAbove(..), Value::String(text)) => match number(text) {
            Some(number) => format!("; write {number} without quotes"),
            None => written(text),
        },
        (Integers(..), Value::Integer(number)) => format!("; write [{number}]"),
        (Integers(..), Value::String(text)) => {
            let items = text.trim_matches(['[', ']']).split(',').map(whole);
            let items: Option<Vec<_>> = items.collect();
            items.map_or_else(String::new, |items| format!("; write {items:?}"))
        }
        _ => String::new(),
    };
    Error::WrongType {
        key: key.to_owned(),
        value: value.to_string(),
        origin: origin.clone(),
        expected: format!("{kind}{hint}"),
    }
}

/// How a number must be written that is meant by other text.
fn written(text: &str) -> String {
    rewritten(text).map_or_else(String::new, |way| format!("; write {way}"))
}

/// The range of a rule, in words.
fn range(rule: Rule) -> String {
    match rule {
        Text => "a string".to_owned(),
        Switch => "true or false".to_owned(),
        Choice(words) => format!("one of {}", words.join(", ")),
        Integer(least, i64::MAX) => format!("an integer of at least {least}"),
        Integer(least, most) => format!("an integer from {least} to {most}"),
        Integers(least, most) => {
            format!("a list of one or more integers from {least} to {most}, as in [1, 3]")
        }
        Number(least, most) => format!("a number from {least} to {most}"),
        NumberAbove(bound, most) => format!("a number above {bound}, up to {most}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(key: &str, value: &str) -> Result<Value> {
        check(key, rule(key).unwrap(), value.parse().unwrap(), &Origin::Set)
    }

    #[test]
    fn takes_numbers_however_they_are_written() {
        assert_eq!(checked("sac.discount", "1").unwrap(), Value::Float(1.0));
        assert_eq!(checked("environment_steps", "1e5").unwrap(), Value::Integer(100_000));
        assert_eq!(checked("seed", "1.0").unwrap(), Value::Integer(1));
        assert_eq!(checked("hksl.skips", "[1.0, 3]").unwrap().to_string(), "[1, 3]");
        assert_eq!(checked("render.device", "1").unwrap(), Value::String("1".into()));
    }

    #[test]
    fn says_how_a_number_must_be_written() {
        for (key, value, way) in [
            ("sac.batch_size", "\"64\"", "write 64 without quotes"),
            ("sac.batch_size", "\"1,000\"", "write 1000"),
            ("environment_steps", "\"100k\"", "write 100000"),
            ("environment_steps", "1.5", "expected an integer"),
            ("sac.discount", "\"0,99\"", "write 0.99"),
            ("hksl.communication", "\"True\"", "write true without quotes"),
            ("hksl.skips", "3", "write [3]"),
            ("hksl.skips", "\"1,3\"", "write [1, 3]"),
        ] {
            let message = checked(key, value).unwrap_err().to_string();
            assert!(message.contains(way), "{message}");
        }
    }

    #[test]
    fn bounds_hold_on_both_sides() {
        for (key, good, bad) in [
            ("sac.discount", "0.0", "-0.1"),
            ("sac.discount", "1.0", "1.1"),
            ("sac.discount", "0.5", "nan"),
            ("sac.learning_rate", "1e-9", "0.0"),
            ("sac.initial_temperature", "0.1", "inf"),
            ("seed", "0", "-1"),
            ("threads", "1", "100000"),
            ("hksl.skips", "[1]", "[]"),
            ("hksl.skips", "[1, 3]", "[1, 0]"),
            ("hksl.initialisation", "\"uniform\"", "\"unifrom\""),
        ] {
            assert!(checked(key, good).is_ok(), "{key} = {good}");
            let message = checked(key, bad).unwrap_err().to_string();
            assert!(message.starts_with(key) && message.contains("must be"), "{message}");
        }
        assert!(matches!(checked("hksl.skips", "[1, \"a\"]"), Err(Error::WrongType { .. })));
        assert!(matches!(checked("hksl.skips", "3"), Err(Error::WrongType { .. })));
    }

    #[test]
    fn every_word_of_a_choice_is_one_that_the_agent_knows() {
        fn check<T: serde::de::DeserializeOwned>(key: &str) {
            let Some(Choice(words)) = rule(key) else { panic!("{key} is not a choice") };
            for word in words {
                let value = Value::String((*word).to_owned()).try_into::<T>();
                assert!(value.is_ok(), "{key} = {word}");
            }
        }
        check::<hksl_core::nn::Initialisation>("hksl.initialisation");
        check::<hksl_sac::config::UpdateSchedule>("hksl.update_schedule");
        check::<hksl_sac::config::ReplayStorage>("replay.storage");
        check::<hksl_sac::config::ShiftPer>("augmentation.shift_per");
    }
}
