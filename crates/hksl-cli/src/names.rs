//! Arguments with known names: listed in help and completions, judged by the library, which knows
//! the nearest names and says where a wrong one stands.

use clap::builder::{PossibleValue, StringValueParser, TypedValueParser};

/// Takes any string; shows the names of the list.
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
        Some(Box::new((self.0)().into_iter().map(PossibleValue::new)))
    }
}
