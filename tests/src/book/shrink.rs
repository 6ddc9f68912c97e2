//! How commands that take hours become such of seconds. What is not replaced goes to the real binary as it stands in
//! the book, so that a wrong option is found.

use toml::{Table, Value};

use super::root;

/// A command of `hksl`, and what makes it small.
struct Small {
    /// Its first words.
    command: &'static str,
    /// Options that get another value where they are given.
    replaced: &'static [(&'static str, &'static str)],
    /// Options that are added where they are not given.
    added: &'static [(&'static str, &'static str)],
}

/// Longer names first.
const COMMANDS: &[Small] = &[
    // `debug` has no place in the folder's name when its settings come as a file.
    Small { command: "train", replaced: &[("--environment-steps", "240")], added: &[] },
    Small {
        command: "eval",
        replaced: &[("--checkpoint", "120"), ("--episodes", "2")],
        added: &[],
    },
    Small { command: "rollout", replaced: &[], added: &[("--steps", "8")] },
    Small {
        command: "probe",
        replaced: &[("--checkpoints", "0,240")],
        added: &[("--train-episodes", "2"), ("--test-episodes", "1")],
    },
    Small {
        command: "analyze-comm",
        replaced: &[("--checkpoint", "120")],
        added: &[("--episodes", "4"), ("--trajectories", "8"), ("--projected", "4")],
    },
    Small {
        command: "attention",
        replaced: &[("--checkpoint", "120"), ("--steps", "0,1,2")],
        added: &[],
    },
    Small { command: "sweep status", replaced: &[], added: &[] },
    Small { command: "sweep", replaced: &[], added: &[("--dry-run", "")] },
    Small {
        command: "report",
        replaced: &[("--replicates", "50"), ("--at", "240"), ("--every", "240")],
        // Runs of the preset itself, which are longer, would else be refused beside the others.
        added: &[("--replicates", "50"), ("--at", "240"), ("--every", "240")],
    },
    Small {
        command: "bench step",
        replaced: &[("--runs", "1"), ("--batch", "2")],
        added: &[("--preset", "debug"), ("--runs", "1")],
    },
    Small {
        command: "bench render",
        replaced: &[("--runs", "2")],
        added: &[("--preset", "debug"), ("--runs", "2")],
    },
    Small {
        command: "bench checkpoint",
        replaced: &[("--transitions", "100")],
        added: &[("--preset", "debug"), ("--transitions", "100")],
    },
    Small { command: "config show", replaced: &[], added: &[] },
    Small { command: "tasks", replaced: &[], added: &[] },
    Small { command: "doctor", replaced: &[], added: &[] },
    Small { command: "completions", replaced: &[], added: &[] },
    Small { command: "man", replaced: &[], added: &[] },
];

/// The words of a command of `hksl`, made small; none if the table does not have it. `settings` is the folder of the
/// files that [`debug_settings`] makes.
pub fn shrunk(words: &[String], settings: &str) -> Option<Vec<String>> {
    if words.iter().any(|word| word == "--help" || word == "--version") {
        return Some(words.to_vec());
    }
    let text = format!("{} ", words.join(" "));
    let small = COMMANDS.iter().find(|small| text.starts_with(&format!("{} ", small.command)))?;
    let mut words = words.to_vec();
    for (option, value) in small.replaced {
        replace(&mut words, option, value);
    }
    // A recorded rollout is as long as its file says.
    let recorded = words.iter().any(|word| word == "--from");
    for (option, value) in small.added.iter().filter(|_| !recorded) {
        if !words.iter().any(|word| word == option) {
            words
                .extend([option, value].into_iter().filter(|w| !w.is_empty()).map(|w| (*w).into()));
        }
    }
    if small.command == "train" {
        words.extend(debug(&words, settings));
    }
    Some(words)
}

/// Gives an option another value.
fn replace(words: &mut [String], option: &str, value: &str) {
    if let Some(place) = words.iter().position(|word| word == option)
        && let Some(given) = words.get_mut(place + 1)
    {
        *given = value.to_owned();
    }
}

/// The word after an option.
pub(super) fn after<'a>(words: &'a [String], option: &str) -> Option<&'a str> {
    words.windows(2).find(|pair| pair[0] == option).map(|pair| pair[1].as_str())
}

/// What makes a run small, unless the command does so itself.
fn debug(words: &[String], settings: &str) -> Vec<String> {
    if words.windows(2).any(|pair| pair == ["--preset", "debug"]) {
        return Vec::new();
    }
    if after(words, "--config").is_some() {
        return ["--preset", "debug"].map(str::to_owned).into();
    }
    let method = after(words, "--method").unwrap_or("hksl");
    vec!["--config".to_owned(), format!("{settings}/{method}.toml")]
}

/// Half the preset's length, and pictures that are drawn faster.
const SHORTER: &str = "
environment_steps = 240
evaluation = { every_environment_steps = 120, episodes = 1 }
checkpoint = { weights_every_environment_steps = 120 }
render = { shadows = false, reflections = false, samples = 0 }
";

/// The preset `debug`, shorter still, as a file of settings for a method: what only others read would be refused there.
///
/// # Panics
/// If the preset cannot be read.
pub fn debug_settings(method: &str) -> String {
    let preset = std::fs::read_to_string(root().join("configs/presets/debug.toml")).unwrap();
    let mut preset: Table = preset.parse().unwrap();
    preset.retain(|key, _| match key {
        "sac" => method != "dreamer-v2",
        "dreamer" => method == "dreamer-v2",
        "hksl" | "pi_sac" | "dbc" => method.replace('-', "_") == key,
        _ => true,
    });
    let shorter: Table = SHORTER.parse().unwrap();
    for (key, value) in shorter {
        match (preset.get_mut(&key).and_then(Value::as_table_mut), value) {
            (Some(section), Value::Table(values)) => section.extend(values),
            (_, value) => drop(preset.insert(key, value)),
        }
    }
    toml::to_string(&preset).unwrap()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(command: &str) -> String {
        let words: Vec<String> = command.split(' ').map(str::to_owned).collect();
        shrunk(&words, "small").unwrap_or_default().join(" ")
    }

    #[test]
    fn commands_become_small() {
        assert_eq!(
            of("train walker-walk --method drq --environment-steps 500000 --seed 2"),
            "train walker-walk --method drq --environment-steps 240 --seed 2 --config small/drq.toml"
        );
        assert_eq!(of("train --preset debug"), "train --preset debug");
        assert_eq!(of("eval RUN --episodes 100"), "eval RUN --episodes 2");
        assert_eq!(of("sweep study.toml"), "sweep study.toml --dry-run");
        assert_eq!(of("sweep study.toml --dry-run"), "sweep study.toml --dry-run");
        assert_eq!(of("sweep status runs"), "sweep status runs");
        assert_eq!(of("train --wrong --help"), "train --wrong --help");
        assert_eq!(of("trains"), "");
    }
}
