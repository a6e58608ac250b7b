//! Width and height of a PNG or JPEG file, from its header alone.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use crate::error::{Error, Result};

/// Reads `(width, height)` in pixels.
pub(crate) fn read(file: &Path) -> Result<(u32, u32)> {
    let input = File::open(file).map_err(|e| Error::io(file, "read", e))?;
    let bad = |why: &str| {
        Error::malformed(file, "image header", format!("{why}, so its size is not known"))
    };
    match size(&mut BufReader::new(input)) {
        Ok(Some(size)) => Ok(size),
        Ok(None) => Err(bad("not that of a PNG or JPEG")),
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Err(bad("not whole")),
        Err(e) => Err(Error::io(file, "read", e)),
    }
}

fn size(input: &mut (impl Read + Seek)) -> io::Result<Option<(u32, u32)>> {
    match take(input)? {
        [0x89, b'P'] => png(input),
        [0xff, 0xd8] => jpeg(input),
        _ => Ok(None),
    }
}

/// After the first two bytes: the rest of the signature, then IHDR, which starts with the size.
fn png(input: &mut impl Read) -> io::Result<Option<(u32, u32)>> {
    let [_, _, _, _, _, _]: [u8; 6] = take(input)?;
    let [_, _, _, _, kind @ ..]: [u8; 8] = take(input)?;
    let (width, height) = (u32::from_be_bytes(take(input)?), u32::from_be_bytes(take(input)?));
    Ok((&kind == b"IHDR").then_some((width, height)))
}

/// After the start-of-image marker: segments up to a start of frame.
fn jpeg(input: &mut (impl Read + Seek)) -> io::Result<Option<(u32, u32)>> {
    loop {
        let [mut byte] = take(input)?;
        if byte != 0xff {
            return Ok(None);
        }
        // Any number of 0xff may precede the marker's code.
        while byte == 0xff {
            [byte] = take(input)?;
        }
        match byte {
            // Markers without a segment.
            0x01 | 0xd0..=0xd7 => {}
            // Start of frame; c4, c8 and cc are other segments of that range.
            0xc0..=0xcf if !matches!(byte, 0xc4 | 0xc8 | 0xcc) => {
                let [_, _, _, h1, h0, w1, w0]: [u8; 7] = take(input)?;
                let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
                return Ok(Some((u32::from(width), u32::from(height))));
            }
            // End of image or start of scan before any start of frame.
            0xd9 | 0xda => return Ok(None),
            _ => {
                let length = u16::from_be_bytes(take(input)?);
                // The length includes its own two bytes. After a seek beyond the end, the next
                // read fails.
                input.seek(SeekFrom::Current(i64::from(length) - 2))?;
            }
        }
    }
}

fn take<const N: usize>(input: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    input.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::size;

    const PNG: &[u8] = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x01\x09\0\0\x01\xda\x08\x02";
    const JPEG: &[u8] =
        b"\xff\xd8\xff\xe0\0\x04ab\xff\xff\xc4\0\x03x\xff\xc2\0\x11\x08\x01\xda\x01\x09\x03";

    #[test]
    fn sizes_are_found() {
        assert_eq!(size(&mut Cursor::new(PNG)).unwrap(), Some((265, 474)));
        assert_eq!(size(&mut Cursor::new(JPEG)).unwrap(), Some((265, 474)));
        assert_eq!(size(&mut Cursor::new(b"GIF89a")).unwrap(), None);
    }

    #[test]
    fn headers_cut_short_are_errors() {
        for header in [&PNG[..24], &JPEG[..23]] {
            for len in 0..header.len() - 1 {
                let outcome = size(&mut Cursor::new(&header[..len]));
                assert!(!matches!(outcome, Ok(Some(_))), "{len}");
            }
        }
    }

    #[test]
    fn a_segment_length_below_two_ends() {
        // Length 0 steps back to the length bytes of the segment, which are not a marker.
        let bytes = b"\xff\xd8\xff\xe0\0\0\0\0";
        assert_eq!(size(&mut Cursor::new(bytes)).unwrap(), None);
    }
}
