//! Events, the data of records.
//!
//! TensorFlow defines the messages in `event.proto`, `summary.proto` and `tensor.proto`, in the
//! Python package `tensorboard` under `tensorboard.compat.proto`. This module contains only the
//! fields that it writes.

use prost::Message;

/// Format version in the first event of a file.
const FILE_VERSION: &str = "brain.Event:2";

/// `DT_STRING` of `types.proto`.
const DT_STRING: i32 = 7;

/// TensorBoard plugin for texts.
const TEXT_PLUGIN: &str = "text";

/// One named value of an event.
///
/// TensorBoard groups values by the part of their tags before the first `/`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value<'a> {
    /// A number.
    Scalar {
        /// Its name.
        tag: &'a str,
        /// The number, stored in single precision: out of range it becomes infinite. NaN and
        /// infinity are written unchanged.
        value: f64,
    },
    /// A text.
    Text {
        /// Its name.
        tag: &'a str,
        /// The text, in Markdown.
        markdown: &'a str,
    },
    /// An image.
    Image {
        /// Its name.
        tag: &'a str,
        /// The image.
        picture: Picture<'a>,
    },
}

/// A PNG image with its size and colour type for TensorBoard, which are not checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Picture<'a> {
    /// The PNG file.
    pub png: &'a [u8],
    /// Width in pixels, at most 2³¹ − 1 as in PNG.
    pub width: u32,
    /// Height in pixels, at most 2³¹ − 1 as in PNG.
    pub height: u32,
    /// Colour type.
    pub colorspace: Colorspace,
}

/// Colour types of `summary.proto` that PNG supports.
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

#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5")]
    what: Option<What>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<SummaryValue>,
}

#[derive(Clone, PartialEq, Message)]
struct SummaryValue {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(oneof = "Content", tags = "2, 4, 8")]
    content: Option<Content>,
    #[prost(message, optional, tag = "9")]
    metadata: Option<SummaryMetadata>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
enum Content {
    #[prost(float, tag = "2")]
    SimpleValue(f32),
    #[prost(message, tag = "4")]
    Image(Image),
    #[prost(message, tag = "8")]
    Tensor(TensorProto),
}

#[derive(Clone, PartialEq, Message)]
struct Image {
    #[prost(int32, tag = "1")]
    height: i32,
    #[prost(int32, tag = "2")]
    width: i32,
    #[prost(int32, tag = "3")]
    colorspace: i32,
    #[prost(bytes = "vec", tag = "4")]
    encoded_image_string: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorProto {
    #[prost(int32, tag = "1")]
    dtype: i32,
    #[prost(message, optional, tag = "2")]
    tensor_shape: Option<TensorShape>,
    #[prost(bytes = "vec", repeated, tag = "8")]
    string_val: Vec<Vec<u8>>,
}

/// Shape of a scalar, which is present but empty.
#[derive(Clone, PartialEq, Message)]
struct TensorShape {}

#[derive(Clone, PartialEq, Message)]
struct SummaryMetadata {
    #[prost(message, optional, tag = "1")]
    plugin_data: Option<PluginData>,
}

#[derive(Clone, PartialEq, Message)]
struct PluginData {
    #[prost(string, tag = "1")]
    plugin_name: String,
}

/// First event of a file.
pub(super) fn version(wall_time: f64) -> Vec<u8> {
    let what = Some(What::FileVersion(FILE_VERSION.to_owned()));
    Event { wall_time, step: 0, what }.encode_to_vec()
}

/// An event with `values`; `None` if there are none.
pub(super) fn summary<'a>(
    wall_time: f64,
    step: i64,
    values: impl IntoIterator<Item = Value<'a>>,
) -> Option<Vec<u8>> {
    let value: Vec<SummaryValue> = values.into_iter().map(SummaryValue::from).collect();
    let what = (!value.is_empty()).then_some(What::Summary(Summary { value }))?;
    Some(Event { wall_time, step, what: Some(what) }.encode_to_vec())
}

impl From<Value<'_>> for SummaryValue {
    fn from(value: Value<'_>) -> Self {
        let of = |tag: &str, content| (tag.to_owned(), Some(content));
        let mut metadata = None;
        let (tag, content) = match value {
            Value::Scalar { tag, value } => of(tag, Content::SimpleValue(value as f32)),
            Value::Image { tag, picture } => of(tag, Content::Image(picture.into())),
            Value::Text { tag, markdown } => {
                let plugin_name = TEXT_PLUGIN.to_owned();
                metadata = Some(SummaryMetadata { plugin_data: Some(PluginData { plugin_name }) });
                of(
                    tag,
                    Content::Tensor(TensorProto {
                        dtype: DT_STRING,
                        tensor_shape: Some(TensorShape {}),
                        string_val: vec![markdown.as_bytes().to_vec()],
                    }),
                )
            }
        };
        Self { tag, content, metadata }
    }
}

impl From<Picture<'_>> for Image {
    fn from(picture: Picture<'_>) -> Self {
        Self {
            height: picture.height as i32,
            width: picture.width as i32,
            colorspace: picture.colorspace as i32,
            encoded_image_string: picture.png.to_vec(),
        }
    }
}
