//! Events: what the records of an event file hold.
//!
//! Their messages are defined in TensorFlow's `event.proto`, `summary.proto` and `tensor.proto`,
//! which the Python package `tensorboard` has as `tensorboard.compat.proto`. Of these, with the
//! fields' numbers:
//!
//! ```text
//! Event            1 double wall_time, 2 int64 step,
//!                  one of: 3 string file_version, 5 Summary summary
//! Summary          1 repeated Value value
//! Value            1 string tag, 9 SummaryMetadata metadata,
//!                  one of: 2 float simple_value, 4 Image image, 8 TensorProto tensor
//! Image            1 int32 height, 2 int32 width, 3 int32 colorspace, 4 bytes encoded_image_string
//! TensorProto      1 DataType dtype, 2 TensorShapeProto tensor_shape, 8 repeated bytes string_val
//! SummaryMetadata  1 PluginData plugin_data
//! PluginData       1 string plugin_name
//! ```

use super::protobuf::Message;

/// Version of the format, as the first event of a file states it.
const FILE_VERSION: &str = "brain.Event:2";

/// `DT_STRING` of `types.proto`.
const DT_STRING: i64 = 7;

/// Part of TensorBoard that shows texts.
const TEXT_PLUGIN: &str = "text";

/// One named value of an event.
///
/// TensorBoard groups values by what stands before the first `/` of their tags.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value<'a> {
    /// A number.
    Scalar {
        /// Its name.
        tag: &'a str,
        /// The number, in single precision in the file: beyond the range of that it becomes
        /// infinite. A number that is not finite is written as it is.
        value: f64,
    },
    /// A text.
    Text {
        /// Its name.
        tag: &'a str,
        /// The text, in Markdown.
        markdown: &'a str,
    },
    /// A picture.
    Image {
        /// Its name.
        tag: &'a str,
        /// The picture.
        picture: Picture<'a>,
    },
}

/// A picture in PNG, and what TensorBoard is told about it; whether that is true is not checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Picture<'a> {
    /// The PNG file.
    pub png: &'a [u8],
    /// Pixels from left to right, at most 2³¹ − 1, as PNG has it.
    pub width: u32,
    /// Pixels from top to bottom, at most 2³¹ − 1, as PNG has it.
    pub height: u32,
    /// What a pixel consists of.
    pub colorspace: Colorspace,
}

/// What a pixel consists of; of `summary.proto`'s list, those that a PNG can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colorspace {
    /// Grey.
    Grey = 1,
    /// Grey and opacity.
    GreyAlpha = 2,
    /// Red, green, blue.
    Rgb = 3,
    /// Red, green, blue, opacity.
    Rgba = 4,
}

/// The first event of a file.
pub(super) fn version(wall_time: f64) -> Vec<u8> {
    Message::default().double(1, wall_time).bytes(3, FILE_VERSION.as_bytes()).into_bytes()
}

/// An event with `values`, if there are any.
pub(super) fn summary<'a>(
    wall_time: f64,
    step: i64,
    values: impl IntoIterator<Item = Value<'a>>,
) -> Option<Vec<u8>> {
    let add = |summary: Option<Message>, value: Value<'a>| {
        Some(summary.unwrap_or_default().message(1, &value.message()))
    };
    let summary = values.into_iter().fold(None, add)?;
    let event = Message::default().double(1, wall_time).integer(2, step);
    Some(event.message(5, &summary).into_bytes())
}

impl Value<'_> {
    fn message(&self) -> Message {
        let tagged = |tag: &str| Message::default().bytes(1, tag.as_bytes());
        match *self {
            Self::Scalar { tag, value } => tagged(tag).float(2, value as f32),
            Self::Image { tag, picture } => tagged(tag).message(4, &picture.message()),
            Self::Text { tag, markdown } => {
                // An empty shape, that of a single value, is stated, not absent.
                let tensor = Message::default()
                    .integer(1, DT_STRING)
                    .message(2, &Message::default())
                    .bytes(8, markdown.as_bytes());
                let plugin = Message::default().bytes(1, TEXT_PLUGIN.as_bytes());
                let metadata = Message::default().message(1, &plugin);
                tagged(tag).message(8, &tensor).message(9, &metadata)
            }
        }
    }
}

impl Picture<'_> {
    fn message(&self) -> Message {
        Message::default()
            .integer(1, self.height.into())
            .integer(2, self.width.into())
            .integer(3, self.colorspace as i64)
            .bytes(4, self.png)
    }
}
