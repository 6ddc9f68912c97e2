//! As much of Protocol Buffers' encoding as events need.
//!
//! Described in "Encoding" of the Protocol Buffers documentation. A message is a row of fields. A
//! field is a tag, which says its number and its wire type, and a value: a varint (wire type 0),
//! eight bytes (1), a length and as many bytes (2) or four bytes (5). A varint holds seven bits a
//! byte, lowest first, with the eighth set in all but the last.

/// A message under way; its fields are to be added in the order of their numbers.
#[derive(Debug, Default)]
pub(super) struct Message(Vec<u8>);

impl Message {
    /// Adds a `double`, or nothing if it is +0.0, which is what its absence means.
    pub(super) fn double(mut self, field: u32, value: f64) -> Self {
        if value.to_bits() != 0 {
            self.tag(field, 1);
            self.0.extend(value.to_le_bytes());
        }
        self
    }

    /// Adds an `int32`, an `int64` or an enum, or nothing if it is 0, which is what its absence
    /// means.
    pub(super) fn integer(mut self, field: u32, value: i64) -> Self {
        if value != 0 {
            self.tag(field, 0);
            // Negative numbers take ten bytes, as the two's complement that they are.
            self.varint(value.cast_unsigned());
        }
        self
    }

    /// Adds a `float` of a `oneof`, where 0.0 differs from absence.
    pub(super) fn float(mut self, field: u32, value: f32) -> Self {
        self.tag(field, 5);
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Adds a `bytes`, or UTF-8 as a `string`.
    pub(super) fn bytes(mut self, field: u32, value: &[u8]) -> Self {
        self.tag(field, 2);
        self.varint(value.len() as u64);
        self.0.extend(value);
        self
    }

    /// Adds a message.
    pub(super) fn message(self, field: u32, value: &Message) -> Self {
        self.bytes(field, &value.0)
    }

    /// The encoded message.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.0
    }

    fn tag(&mut self, field: u32, wire_type: u32) {
        self.varint(u64::from(field << 3 | wire_type));
    }

    fn varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.0.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.0.push(value as u8);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn varints_grow_a_byte_every_seven_bits() {
        let encoded = |value| Message::default().integer(1, value).into_bytes();
        assert_eq!(encoded(1), [0x08, 0x01]);
        assert_eq!(encoded(127), [0x08, 0x7F]);
        assert_eq!(encoded(128), [0x08, 0x80, 0x01]);
        assert_eq!(encoded(150), [0x08, 0x96, 0x01]);
        let minus_one = [&[0x08][..], &[0xFF; 9], &[0x01]].concat();
        assert_eq!(encoded(-1), minus_one);
    }

    #[test]
    fn only_what_equals_its_absence_is_left_out() {
        assert!(Message::default().double(1, 0.0).integer(2, 0).into_bytes().is_empty());
        assert_eq!(
            Message::default().double(1, -0.0).into_bytes(),
            [0x09, 0, 0, 0, 0, 0, 0, 0, 0x80]
        );
        assert_eq!(Message::default().float(2, 0.0).into_bytes(), [0x15, 0, 0, 0, 0]);
        assert_eq!(
            Message::default().message(16, &Message::default()).into_bytes(),
            [0x82, 0x01, 0]
        );
    }
}
