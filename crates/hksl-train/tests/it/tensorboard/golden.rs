//! Events with the records that they are to become.

use hksl_train::metrics::{Colorspace, EventFile, Picture, Value};

/// Time of the first event.
pub const START: f64 = 1.7e9;

/// Records as `fixtures/make_golden.py` prints them, by name.
pub const GOLDEN: [(&str, &str); 5] = [
    ("VERSION", VERSION),
    ("SCALAR", SCALAR),
    ("SCALARS", SCALARS),
    ("TEXT", TEXT),
    ("IMAGE", IMAGE),
];

/// The first event.
pub const VERSION: &str = "\
    1800000000000000a37f4b220900000040fc54d9411a0d627261696e2e4576656e743a32eced8f9d";

/// One number.
pub const SCALAR: &str = "\
    2500000000000000eabc36f30900001040fc54d94110ac022a170a150a0e657069736f64652f7265\
    7475726e15cdcccc3d881acb16";

/// Several numbers, time and step 0.
pub const SCALARS: &str = "\
    3500000000000000d6c55de62a330a0a0a036e616e150000c07f0a0a0a036c6f7715000080ff0a0b\
    0a047a65726f15000000000a0c0a056d696e75731500000080868693f6";

/// A text.
pub const TEXT: &str = "\
    4a00000000000000af77dbb00900002040fc54d94110ffffffffffffffffff012a340a320a06636f\
    6e666967421e0807120042182a2a626f6c642a2a20e2809320c2bd0a0a0961203d20310a4a080a06\
    0a047465787413619a57";

/// A picture.
pub const IMAGE: &str = "\
    76000000000000004e43f07d0900003040fc54d941108080808080202a640a620a0b6672616d6573\
    2f6576616c2253080110021803224b89504e470d0a1a0a0000000d49484452000000020000000108\
    020000007b40e8dd00000012494441547801010700f8ff00ff00000000ff070001ff5536bac70000\
    000049454e44ae426082bce0ceb4";

/// What `TEXT` says.
pub const MARKDOWN: &str = "**bold** – ½\n\n\ta = 1\n";

/// Two pixels side by side, red and blue.
pub fn png() -> Vec<u8> {
    bytes(
        "\
        89504e470d0a1a0a0000000d49484452000000020000000108020000007b40e8dd00000012494441\
        547801010700f8ff00ff00000000ff070001ff5536bac70000000049454e44ae426082",
    )
}

/// Hex as bytes.
pub fn bytes(hex: &str) -> Vec<u8> {
    let byte = |at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(byte).collect()
}

/// Bytes as hex.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes the golden event that is `index` places behind the first.
pub fn write(events: &mut EventFile, index: usize) {
    let scalar = |tag, value| Value::Scalar { tag, value };
    let png = png();
    let picture = Picture { png: &png, width: 2, height: 1, colorspace: Colorspace::Rgb };
    let written = match index {
        1 => events.write(START + 0.25, 300, [scalar("episode/return", 0.1)]),
        2 => {
            let low = scalar("low", f64::NEG_INFINITY);
            let zeros = [scalar("zero", 0.0), scalar("minus", -0.0)];
            events.write(0.0, 0, [scalar("nan", f64::NAN), low].into_iter().chain(zeros))
        }
        3 => events.write(START + 0.5, -1, [Value::Text { tag: "config", markdown: MARKDOWN }]),
        4 => events.write(START + 0.75, 1 << 40, [Value::Image { tag: "frames/eval", picture }]),
        _ => panic!("there is no golden event {index}"),
    };
    written.unwrap();
}
