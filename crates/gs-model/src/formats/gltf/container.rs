//! The GLB container: a header, a chunk of JSON, a chunk of data.

use crate::bytes::word;

/// What a GLB file starts with.
pub(super) const MAGIC: &[u8] = b"glTF";
const VERSION: u32 = 2;
const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
const JSON: &[u8; 4] = b"JSON";
const DATA: &[u8; 4] = b"BIN\0";

/// The JSON and the data of a file, where a `.gltf` has no data; an error is what is wrong with it.
pub(super) fn split(bytes: &[u8]) -> Result<(&[u8], &[u8]), &'static str> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    if text.starts_with(b"{") {
        return Ok((text, &[]));
    }
    if !bytes.starts_with(MAGIC) || bytes.len() < HEADER {
        return Err("it starts neither with \"glTF\" nor as JSON");
    }
    if word(bytes, 4) != VERSION {
        return Err("another version of the container than 2");
    }
    const SHORT: &str = "it promises more than is there: it is cut short; get it again";
    let body = bytes.get(HEADER..word(bytes, 8) as usize).ok_or(SHORT)?;
    let (kind, json, rest) = chunk(body).ok_or(SHORT)?;
    if kind != JSON {
        return Err("its first chunk is not JSON");
    }
    if rest.is_empty() {
        return Ok((json, &[]));
    }
    let (kind, data, _) = chunk(rest).ok_or(SHORT)?;
    // Chunks of other kinds may follow; before the data there are none.
    Ok((json, if kind == DATA { data } else { &[] }))
}

/// Kind and contents of the first chunk, and what follows it.
fn chunk(bytes: &[u8]) -> Option<(&[u8], &[u8], &[u8])> {
    let (head, rest) = bytes.split_at_checked(CHUNK_HEADER)?;
    let (contents, rest) = rest.split_at_checked(word(head, 0) as usize)?;
    Some((&head[4..], contents, rest))
}

/// The head of a file of `data_len` bytes of data, up to where the data starts; `None` if the file
/// would be longer than its header can say. `data_len` is a multiple of 4.
pub(super) fn head(json: &[u8], data_len: u64) -> Option<Vec<u8>> {
    let json_len = json.len().next_multiple_of(4);
    let total = (HEADER + 2 * CHUNK_HEADER + json_len) as u64 + data_len;
    let [total, data_len] = [u32::try_from(total).ok()?, u32::try_from(data_len).ok()?];
    let mut out = MAGIC.to_vec();
    out.extend(VERSION.to_le_bytes());
    out.extend(total.to_le_bytes());
    out.extend((json_len as u32).to_le_bytes());
    out.extend(JSON);
    out.extend(json);
    out.resize(HEADER + CHUNK_HEADER + json_len, b' ');
    out.extend(data_len.to_le_bytes());
    out.extend(DATA);
    Some(out)
}
