//! `gsvx encode --max-error`: bounds on errors, and what they became.

use crate::output::counted;
use gsvx::{EncodedStream, MaxError};
use serde_json::{Value, json};

/// Reads `0.01`, or `0.01,mean=0.05`, or a number for each name.
pub(crate) fn parse(text: &str) -> Result<MaxError, String> {
    let mut others = None;
    let mut named = [("mean", None), ("opacity", None), ("shape", None), ("sh", None)];
    for part in text.split(',') {
        let (name, number) = match part.split_once('=') {
            Some((name, number)) => (Some(name.trim()), number),
            None => (None, part),
        };
        let number: f32 = number.trim().parse().map_err(|_| USE.to_owned())?;
        let slot = match name {
            None => &mut others,
            Some(name) => {
                let known = named.iter_mut().find(|n| n.0 == name);
                &mut known.ok_or_else(|| USE.to_owned())?.1
            }
        };
        if slot.replace(number).is_some() {
            return Err(format!("{part}: given twice"));
        }
    }
    let value = |k: usize| {
        let (name, given) = named[k];
        given.or(others).ok_or_else(|| {
            format!("no bound for {name}; a number without a name is for all others")
        })
    };
    let bounds = MaxError { mean: value(0)?, opacity: value(1)?, shape: value(2)?, sh: value(3)? };
    bounds.check().map_err(|e| e.to_string())?;
    Ok(bounds)
}

const USE: &str =
    "use a number such as 0.01, or 0.01,mean=0.05 with the names mean, opacity, shape, sh";

/// For a person.
pub(crate) fn human(encoded: &EncodedStream) -> Option<String> {
    let e = encoded.max_error?;
    Some(format!(
        "largest errors, measured: mean {:.2e} of the Gaussian's longest axis, opacity {:.2e}, shape {:.2e}, \
         SH {:.2e}; {} coded exactly",
        e.mean,
        e.opacity,
        e.shape,
        e.sh,
        counted(encoded.exact(), "Gaussian")
    ))
}

/// The same as JSON.
pub(crate) fn json(encoded: &EncodedStream) -> Option<Value> {
    let MaxError { mean, opacity, shape, sh } = encoded.max_error?;
    let exact = encoded.exact();
    Some(json!({ "mean": mean, "opacity": opacity, "shape": shape, "sh": sh, "exact": exact }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_read() {
        assert_eq!(parse("0.01"), Ok(MaxError::all(0.01)));
        let some = parse("0.01,mean=0.05, sh=2e-3").unwrap();
        assert_eq!(some, MaxError { mean: 0.05, sh: 0.002, ..MaxError::all(0.01) });
        let all = parse("mean=1,opacity=2,shape=3,sh=4").unwrap();
        assert_eq!(all, MaxError { mean: 1.0, opacity: 2.0, shape: 3.0, sh: 4.0 });
        for wrong in ["", "x", "0", "-1", "nan", "0.1,0.2", "mean=0.1", "size=1", "0.1,sh=1,sh=2"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
