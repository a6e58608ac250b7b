//! [`Request`]: the head of an HTTP request.

/// The head of a request.
pub(super) struct Request<'a> {
    pub(super) method: &'a str,
    /// With the query.
    pub(super) target: &'a str,
    pub(super) fields: &'a [httparse::Header<'a>],
}

impl Request<'_> {
    /// The value of a field; `None` if it is not there exactly once, as text.
    pub(super) fn field(&self, name: &str) -> Option<&str> {
        let mut found = self.fields.iter().filter(|f| f.name.eq_ignore_ascii_case(name));
        let value = found.next().and_then(|f| std::str::from_utf8(f.value).ok())?;
        found.next().is_none().then_some(value)
    }

    /// Whether a body follows.
    pub(super) fn has_body(&self) -> bool {
        let says = |name: &str| self.fields.iter().any(|f| f.name.eq_ignore_ascii_case(name));
        says("Transfer-Encoding")
            || (says("Content-Length") && self.field("Content-Length") != Some("0"))
    }
}
