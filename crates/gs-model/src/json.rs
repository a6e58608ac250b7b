//! JSON as Python writes it.

/// JSON in which the numbers that it does not have (`NaN`, `Infinity`) are null.
pub(crate) fn without_nan(json: &[u8]) -> Vec<u8> {
    const WORDS: [&[u8]; 3] = [b"-Infinity", b"Infinity", b"NaN"];
    let mut out = Vec::with_capacity(json.len());
    let (mut rest, mut quoted) = (json, false);
    while let [byte, after @ ..] = rest {
        let word = WORDS.into_iter().find(|word| !quoted && rest.starts_with(word));
        let (said, behind) = match (word, byte) {
            (Some(word), _) => (&b"null"[..], &rest[word.len()..]),
            (_, b'\\') if quoted => rest.split_at(rest.len().min(2)),
            _ => (&rest[..1], after),
        };
        quoted ^= *byte == b'"';
        out.extend(said);
        rest = behind;
    }
    out
}
