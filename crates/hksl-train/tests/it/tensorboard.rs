//! Event files: their bytes, how they are resumed, and what TensorBoard's own reader finds in them.

mod bytes;
mod golden;
mod read_back;
