//! Which program this is.

/// The commit that the program was built from, `unknown` outside a git checkout.
pub const COMMIT: &str = match option_env!("HKSL_COMMIT") {
    Some(commit) => commit,
    None => "unknown",
};

/// Which version this program is, and of which sources.
pub(crate) fn this_version() -> String {
    version(env!("CARGO_PKG_VERSION"), COMMIT)
}

/// A version and its commit, for people.
pub(crate) fn version(number: &str, commit: &str) -> String {
    format!("hksl {number} (commit {commit})")
}
