//! Arguments with a fixed set of names. Help and completions list the names; the library validates them,
//! because its errors suggest the nearest name.

use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};
use hksl_train::config;

/// Accepts any string and lists the known names in help.
#[derive(Debug, Clone)]
pub struct Listed(pub fn() -> Vec<&'static str>);

impl TypedValueParser for Listed {
    type Value = String;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &std::ffi::OsStr,
    ) -> Result<String, clap::Error> {
        StringValueParser::new().parse_ref(command, argument, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new((self.0)().into_iter().map(possible_value)))
    }
}

/// The name, with its registry's summary if it is a method's or a task's.
fn possible_value(name: &'static str) -> PossibleValue {
    let method = config::METHODS.iter().find(|method| method.name == name);
    let task = hksl_envs::tasks().iter().find(|task| task.name == name);
    let summary = method.map(|method| method.summary).or(task.map(|task| task.summary));
    match summary {
        Some(summary) => PossibleValue::new(name).help(summary),
        None => PossibleValue::new(name),
    }
}
