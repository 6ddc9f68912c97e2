//! How a configuration is put together, refused, written and compared.

mod bad_input;
mod layers;
mod round_trip;

use hksl_train::config::{Request, Resolved, resolve};

/// What `hksl train TASK --set …` would ask for.
fn request(task: &str, sets: &[&str]) -> Request {
    Request {
        task: Some(task.to_owned()),
        sets: sets.iter().map(|set| (*set).to_owned()).collect(),
        ..Request::default()
    }
}

fn resolved(request: &Request) -> Resolved {
    resolve(request).unwrap_or_else(|error| panic!("{request:?}: {error}"))
}

/// The message of a refusal, which must be the user's fault.
fn refusal(request: &Request) -> String {
    let error = resolve(request).err().unwrap_or_else(|| panic!("{request:?} was accepted"));
    assert!(error.is_usage(), "{error}");
    error.to_string()
}

fn assert_words(message: &str, words: &[&str]) {
    for word in words {
        assert!(message.contains(word), "`{word}` is missing in: {message}");
    }
}
