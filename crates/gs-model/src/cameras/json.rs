//! The JSON of camera files, as tools write it: with a byte order mark, with Python's `NaN`, with numbers as text.

use std::path::Path;

use serde_json::Value;

use crate::error::{Error, Result};
use crate::{fs, json};

/// Parses a camera file. Numbers that JSON does not have (`NaN`, `Infinity`) are null.
///
/// # Errors
/// [`Error::Malformed`] with line and column.
pub(crate) fn parse(file: &Path, bytes: &[u8]) -> Result<Value> {
    let text = json::without_nan(&fs::text(bytes));
    if text.trim_ascii().is_empty() {
        return Err(Error::malformed(file, "line 1", "it is empty; export the cameras again"));
    }
    serde_json::from_slice(&text).map_err(|e| Error::json(file, "a camera file", &e))
}

/// A number, also one that is written as text.
pub(crate) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::String(text) => text.trim().parse().ok().filter(|v: &f64| v.is_finite()),
        other => other.as_f64(),
    }
}

/// All numbers of nested lists, in order; `None` if there is anything else, or more than `most`.
pub(crate) fn numbers(value: &Value, most: usize) -> Option<Vec<f64>> {
    let mut out = Vec::new();
    let lists = match value {
        Value::Array(items) => items.iter().map(|item| match item {
            Value::Array(row) => row.iter(),
            one => std::slice::from_ref(one).iter(),
        }),
        _ => return None,
    };
    for item in lists.flatten() {
        if out.len() == most {
            return None;
        }
        out.push(number(item)?);
    }
    Some(out)
}

/// A text, or a number as text.
pub(crate) fn text(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_python_writes_is_read() {
        let read = |text: &[u8]| parse(Path::new("-"), text).unwrap();
        let text = br#"{"a": NaN, "b": [-Infinity, Infinity, -1], "NaN\"NaN": "Infinity \\"}"#;
        let found = json!({"a": null, "b": [null, null, -1], "NaN\"NaN": "Infinity \\"});
        assert_eq!(read(text), found);
        assert_eq!(read(&[b"\xef\xbb\xbf", &text[..]].concat()), found);
        let wide: Vec<u8> = b"\xff\xfe{\0}\0".to_vec();
        assert_eq!(read(&wide), json!({}));
    }

    #[test]
    fn broken_json_is_said_in_plain_words() {
        let said =
            |text: &str| crate::chain(&parse(Path::new("a.json"), text.as_bytes()).unwrap_err());
        assert!(said("[1, 2").contains("a.json: line 1, column 5: the JSON ends too early"));
        assert!(said("[1,\n x]").contains("line 2, column 2: broken JSON"));
        assert!(said(" ").contains("it is empty"));
    }

    #[test]
    fn numbers_may_be_text() {
        assert_eq!(number(&json!(" 1e3")), Some(1000.0));
        assert_eq!(number(&json!("NaN")), None);
        assert_eq!(numbers(&json!([[1, "2"], [3, 4]]), 4), Some(vec![1.0, 2.0, 3.0, 4.0]));
        assert_eq!(numbers(&json!([[1, 2], [3, 4]]), 3), None);
        assert_eq!(numbers(&json!([null]), 3), None);
    }
}
