//! Records, the framing of events in a file.
//!
//! The format is TFRecord, described in TensorFlow's guide "TFRecord and tf.train.Example" and
//! implemented by `RecordWriter` of the Python package `tensorboard`. All numbers are
//! little-endian:
//!
//! | bytes    | what                                     |
//! |----------|------------------------------------------|
//! | 8        | `length` of the data                     |
//! | 4        | masked CRC-32C of the eight bytes before |
//! | `length` | the data                                 |
//! | 4        | masked CRC-32C of the data               |

use std::io::{Read, Result, Seek, SeekFrom};

/// Bytes of the header: length of the data and its checksum.
const HEADER: usize = 12;

/// Bytes of the footer: checksum of the data.
const FOOTER: u64 = 4;

/// Masked checksum: rotated right by 15 bits, plus a constant. Data may then contain their own
/// masked checksum without weakening it.
fn masked_crc32c(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xA282_EAD8)
}

/// Encodes `data` as a record.
pub(super) fn framed(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(HEADER + data.len() + FOOTER as usize);
    record.extend(length);
    record.extend(masked_crc32c(&length).to_le_bytes());
    record.extend(data);
    record.extend(masked_crc32c(data).to_le_bytes());
    record
}

/// Why the first `length` bytes of `file` are not complete records, if so. The file must be at
/// least as long.
///
/// Reads only headers and skips data and their checksums.
pub(super) fn check(file: &mut (impl Read + Seek), length: u64) -> Result<Option<String>> {
    let mut at = 0;
    while at < length {
        let cut = format!("the truncation point, byte {length}, is inside the record at byte {at}");
        if length - at < HEADER as u64 {
            return Ok(Some(cut));
        }
        file.seek(SeekFrom::Start(at))?;
        let mut header = [0; HEADER];
        file.read_exact(&mut header)?;
        let [size @ .., _, _, _, _] = header;
        let [.., a, b, c, d] = header;
        if u32::from_le_bytes([a, b, c, d]) != masked_crc32c(&size) {
            return Ok(Some(format!("no record begins at byte {at}")));
        }
        let whole = u64::from_le_bytes(size).checked_add(HEADER as u64 + FOOTER);
        match whole.and_then(|whole| at.checked_add(whole)) {
            Some(end) if end <= length => at = end,
            _ => return Ok(Some(cut)),
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn only_ends_of_records_pass() {
        let file: Vec<u8> = [&b"one"[..], b"", b"three"].into_iter().flat_map(framed).collect();
        let ends = [0, 19, 35, 56];
        for length in 0..=file.len() as u64 {
            let fault = check(&mut Cursor::new(&file), length).unwrap();
            assert_eq!(fault.is_none(), ends.contains(&length), "{length}: {fault:?}");
        }
    }

    #[test]
    fn lengths_without_their_checksum_and_lengths_beyond_all_bounds_do_not_pass() {
        let fault = check(&mut Cursor::new([0; 100]), 100).unwrap().unwrap();
        assert_eq!(fault, "no record begins at byte 0");
        let mut file = u64::MAX.to_le_bytes().to_vec();
        file.extend(masked_crc32c(&file).to_le_bytes());
        file.extend([0; 88]);
        let fault = check(&mut Cursor::new(file), 100).unwrap().unwrap();
        assert_eq!(fault, "the truncation point, byte 100, is inside the record at byte 0");
    }
}
