//! CRC-32C, the checksum of records.
//!
//! CRC with Castagnoli's polynomial, as RFC 3720 (iSCSI), section 12.1 and appendix B.4, has it:
//! bits reflected, all ones at the start, inverted at the end. A table of our own instead of a
//! crate: records are small and few, so that a byte at a time is fast enough, and the whole of it
//! is these lines.

/// Castagnoli's polynomial 0x1EDC6F41, lowest power in the highest bit.
const POLYNOMIAL: u32 = 0x82F6_3B78;

/// What each value of a byte does to the checksum.
static TABLE: [u32; 256] = table();

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = (crc >> 1) ^ (POLYNOMIAL * (crc & 1));
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// The checksum of `bytes`.
pub(super) fn crc32c(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| (crc >> 8) ^ TABLE[usize::from(crc as u8 ^ byte)];
    !bytes.iter().fold(u32::MAX, step)
}

/// The checksum as records hold it: rotated right by 15 bits, a constant added. The checksum of
/// data that contain their own checksum says little; a masked one may be contained.
pub(super) fn masked_crc32c(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xA282_EAD8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_examples_of_rfc_3720() {
        let ascending: Vec<u8> = (0..32).collect();
        let descending: Vec<u8> = (0..32).rev().collect();
        assert_eq!(crc32c(&[0; 32]), 0x8A91_36AA);
        assert_eq!(crc32c(&[0xFF; 32]), 0x62A8_AB43);
        assert_eq!(crc32c(&ascending), 0x46DD_794E);
        assert_eq!(crc32c(&descending), 0x113F_DB5C);
    }

    #[test]
    fn the_usual_check_value_and_nothing_at_all() {
        assert_eq!(crc32c(b"123456789"), 0xE306_9283);
        assert_eq!(crc32c(b""), 0);
        assert_eq!(masked_crc32c(b""), 0xA282_EAD8);
    }
}
