//! Numbers as people write them on a command line: 1MB, 500k, 2.5M.

/// Units of bytes, the longest names first. A k is a thousand, a Ki is 1024.
const BYTES: [(&str, f64); 13] = [
    ("kib", 1024.0),
    ("mib", 1_048_576.0),
    ("gib", 1_073_741_824.0),
    ("ki", 1024.0),
    ("mi", 1_048_576.0),
    ("gi", 1_073_741_824.0),
    ("kb", 1e3),
    ("mb", 1e6),
    ("gb", 1e9),
    ("k", 1e3),
    ("m", 1e6),
    ("g", 1e9),
    ("b", 1.0),
];
/// Units of counts.
const COUNT: [(&str, f64); 3] = [("k", 1e3), ("m", 1e6), ("g", 1e9)];

/// A number of bytes.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    parse(text, &BYTES).ok_or_else(|| "use a size such as 800000, 500k, 1.5MB or 2MiB".into())
}

/// A number of things.
pub(crate) fn count(text: &str) -> Result<u64, String> {
    parse(text, &COUNT).ok_or_else(|| "use a number such as 800000, 500k or 2M".into())
}

/// A positive number.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0);
    value.ok_or_else(|| "use a positive number".into())
}

fn parse(text: &str, units: &[(&str, f64)]) -> Option<u64> {
    let text = text.trim().to_ascii_lowercase();
    let unit = units.iter().find_map(|&(u, f)| Some((text.strip_suffix(u)?, f)));
    let (number, factor) = unit.unwrap_or((&text, 1.0));
    let number = number.trim_end();
    if factor == 1.0
        && let Ok(exact) = number.parse::<u64>()
    {
        return (exact > 0).then_some(exact);
    }
    // Words such as inf are numbers to Rust, but not here.
    if !number.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
        return None;
    }
    let value = number.parse::<f64>().ok()? * factor;
    (1.0..9e18).contains(&value).then(|| value.round() as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_took_only_plain_numbers() {
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
