//! Numbers as people write them on a command line: 1MB, 500k, 2.5M.

use parse_size::{ByteSuffix, Config};
use std::str::FromStr;

/// A number of bytes. A k is a thousand, a Ki is 1024.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let bytes = parse_size::parse_size(text).ok().filter(|&n| n > 0);
    bytes.ok_or_else(|| "use a size such as 800000, 500k, 1.5MB or 2MiB".into())
}

/// A number of things.
pub(crate) fn count(text: &str) -> Result<u64, String> {
    let config = Config::new().with_byte_suffix(ByteSuffix::Deny);
    let count = config.parse_size(text).ok().filter(|&n| n > 0);
    count.ok_or_else(|| "use a number such as 800000, 500k or 2M".into())
}

/// A positive number.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    number(text, |v| v.is_finite() && *v > 0.0, "use a positive number")
}

/// A number that `fits`; `usage` says which do.
pub(crate) fn number(text: &str, fits: impl Fn(&f64) -> bool, usage: &str) -> Result<f64, String> {
    text.parse().ok().filter(fits).ok_or_else(|| usage.into())
}

/// Reads `N` numbers between separators.
pub(crate) fn list<T: FromStr, const N: usize>(text: &str, separator: char) -> Option<[T; N]> {
    let parts = text.split(separator).map(|part| part.trim().parse().ok());
    parts.collect::<Option<Vec<T>>>()?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units_and_fractions() {
        let good = [
            ("1", 1),
            ("1000000", 1_000_000),
            ("1MB", 1_000_000),
            ("1 mb", 1_000_000),
            ("500k", 500_000),
            ("1.5M", 1_500_000),
            ("2MiB", 2_097_152),
            ("4Ki", 4096),
            ("1e6", 1_000_000),
            ("12b", 12),
            ("18446744073709551615", u64::MAX),
        ];
        for (text, value) in good {
            assert_eq!(bytes(text), Ok(value), "{text}");
        }
        for text in ["", "k", "-1", "0", "1X", "1MBk", "inf", "nan", "0.1", "1e30"] {
            assert!(bytes(text).is_err(), "{text}");
        }
        assert_eq!(count("2M"), Ok(2_000_000));
        assert!(count("2MB").is_err());
    }
}
