//! Event files: their bytes, how they are resumed, and what TensorBoard's own reader finds in them.

// Helpers outside `#[test]` functions may unwrap as well.
#![allow(clippy::unwrap_used)]

#[path = "tensorboard/bytes.rs"]
mod bytes;
#[path = "tensorboard/golden.rs"]
mod golden;
#[path = "tensorboard/read_back.rs"]
mod read_back;
