//! What tells contents apart: SHA-256, in hexadecimal digits.

use sha2::Digest as _;

/// The SHA-256 of these bytes, as `sha256sum` writes it.
///
/// ```
/// let digest = hksl_files::digest::sha256(b"");
/// assert!(digest.starts_with("e3b0c44298fc1c14") && digest.len() == 64);
/// ```
pub fn sha256(bytes: impl AsRef<[u8]>) -> String {
    let mut sha = Sha256::default();
    sha.update(bytes);
    sha.finish()
}

/// The same of bytes that come one after the other.
#[derive(Debug, Clone, Default)]
pub struct Sha256(sha2::Sha256);

impl Sha256 {
    /// Takes in more bytes.
    pub fn update(&mut self, bytes: impl AsRef<[u8]>) {
        self.0.update(bytes);
    }

    /// The digest of all of them.
    pub fn finish(self) -> String {
        self.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}
