//! The fuzz targets' corpora, and what fuzzing has found, through the readers: none may panic.

use std::path::Path;

use hksl_tests::untrusted;

fn feed(target: &str, reader: fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus").join(target);
    let mut fed = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        println!("{}", path.display());
        reader(&bytes);
        // And what is near to it: cut short anywhere, one bit turned in many places.
        for step in 0..64 {
            let place = bytes.len() * step / 64;
            reader(&bytes[..place]);
            let mut turned = bytes.clone();
            if let Some(byte) = turned.get_mut(place) {
                *byte ^= 1 << (step % 8);
            }
            reader(&turned);
        }
        fed += 1;
    }
    assert!(fed > 0, "{} is empty", folder.display());
}

#[test]
fn configurations() {
    feed("configuration", untrusted::configuration);
}

#[test]
fn checkpoints() {
    feed("checkpoint", untrusted::checkpoint);
}

#[cfg(feature = "mujoco")]
#[test]
fn rollouts() {
    feed("rollout", untrusted::rollout);
}

#[test]
fn episodes() {
    feed("episode", untrusted::episode);
}
