//! Point clouds as MPEG's tmc3 reads and writes them: integer positions with one attribute.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use gpcc_lite::morton;

/// Integers of one attribute: three 8-bit channels, or one of 16 bits.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Channels {
    /// Three channels of 8 bits.
    Colour(Vec<[u8; 3]>),
    /// One channel of 16 bits.
    Scalar(Vec<u16>),
}

impl Channels {
    pub(crate) fn is_colour(&self) -> bool {
        matches!(self, Self::Colour(_))
    }

    /// The entries in another order: entry `i` is the old entry `order[i]`.
    fn reordered(&self, order: &[usize]) -> Self {
        match self {
            Self::Colour(all) => Self::Colour(order.iter().map(|&i| all[i]).collect()),
            Self::Scalar(all) => Self::Scalar(order.iter().map(|&i| all[i]).collect()),
        }
    }
}

/// Writes integer positions as floats, with one attribute.
pub(crate) fn write(path: &Path, at: &[[u32; 3]], channels: &Channels) -> Result<()> {
    let properties = match channels {
        Channels::Colour(_) => "property uchar red\nproperty uchar green\nproperty uchar blue",
        Channels::Scalar(_) => "property ushort reflectance",
    };
    let mut out = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\n{properties}\nend_header\n",
        at.len()
    )
    .into_bytes();
    for (i, p) in at.iter().enumerate() {
        for &axis in p {
            out.extend((axis as f32).to_le_bytes());
        }
        match channels {
            Channels::Colour(all) => out.extend(all[i]),
            Channels::Scalar(all) => out.extend(all[i].to_le_bytes()),
        }
    }
    fs::File::create(path)
        .and_then(|mut f| f.write_all(&out))
        .with_context(|| format!("write {}", path.display()))
}

/// Type of a property: its size, and how its bytes become a number.
fn number(kind: &str, b: &[u8]) -> Option<(usize, f64)> {
    let size = match kind {
        "char" | "uchar" | "int8" | "uint8" => 1,
        "short" | "ushort" | "int16" | "uint16" => 2,
        "int" | "uint" | "int32" | "uint32" | "float" | "float32" => 4,
        "double" | "float64" => 8,
        _ => return None,
    };
    let raw = b.get(..size)?;
    let mut word = [0u8; 8];
    word[..size].copy_from_slice(raw);
    let bits = u64::from_le_bytes(word);
    let value = match kind {
        "float" | "float32" => f64::from(f32::from_bits(bits as u32)),
        "double" | "float64" => f64::from_bits(bits),
        "char" | "int8" => f64::from(bits as u8 as i8),
        "short" | "int16" => f64::from(bits as u16 as i16),
        "int" | "int32" => f64::from(bits as u32 as i32),
        _ => bits as f64,
    };
    Some((size, value))
}

/// Reads positions and their attribute, which is a colour where there is one. In Morton order.
pub(crate) fn read(path: &Path) -> Result<(Vec<[u32; 3]>, Channels)> {
    let shown = path.display();
    let data = fs::read(path).with_context(|| format!("read {shown}"))?;
    let mark = b"end_header\n";
    let end = data.windows(mark.len()).position(|w| w == mark);
    let end = end.with_context(|| format!("{shown}: no end_header"))? + mark.len();
    let header = String::from_utf8_lossy(&data[..end]);
    ensure!(header.contains("binary_little_endian"), "{shown}: not binary_little_endian");
    let count = header.lines().find_map(|l| l.strip_prefix("element vertex "));
    let count: usize =
        count.with_context(|| format!("{shown}: no vertex count"))?.trim().parse()?;
    let properties: Vec<(&str, &str)> = header
        .lines()
        .filter_map(|l| l.strip_prefix("property ")?.split_once(' '))
        .map(|(kind, name)| (kind, name.trim()))
        .collect();
    let colour = properties.iter().any(|p| p.1 == "red");
    let wanted: &[&[&str]] = if colour {
        &[&["x"], &["y"], &["z"], &["red"], &["green"], &["blue"]]
    } else {
        &[&["x"], &["y"], &["z"], &["reflectance", "refc", "refl"]]
    };
    let mut columns = Vec::new();
    for names in wanted {
        let found = properties.iter().position(|p| names.contains(&p.1));
        columns.push(found.with_context(|| format!("{shown}: no property {}", names[0]))?);
    }
    // At least a byte per row, so a false count cannot ask for memory.
    ensure!(count <= data.len(), "{shown}: {count} vertices in {} bytes", data.len());
    let mut at = Vec::with_capacity(count);
    let (mut colours, mut scalars) = (Vec::new(), Vec::new());
    let mut body = &data[end..];
    let mut row = vec![0.0; properties.len()];
    for i in 0..count {
        for (value, (kind, _)) in row.iter_mut().zip(&properties) {
            let Some((size, v)) = number(kind, body) else {
                bail!("{shown}: vertex {i} is cut off or of type {kind}")
            };
            (*value, body) = (v, &body[size..]);
        }
        let get = |k: usize| row[columns[k]];
        at.push([0, 1, 2].map(|k| get(k).round().max(0.0) as u32));
        if colour {
            colours.push([3, 4, 5].map(|k| get(k).clamp(0.0, 255.0) as u8));
        } else {
            scalars.push(get(3).clamp(0.0, 65535.0) as u16);
        }
    }
    let channels = if colour { Channels::Colour(colours) } else { Channels::Scalar(scalars) };
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_unstable_by_key(|&i| morton::encode(at[i]));
    Ok((order.iter().map(|&i| at[i]).collect(), channels.reordered(&order)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_come_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.ply");
        let at = vec![[1, 2, 3], [0, 5, 70_000]];
        for channels in
            [Channels::Colour(vec![[1, 2, 3], [255, 0, 9]]), Channels::Scalar(vec![7, 65535])]
        {
            write(&path, &at, &channels).unwrap();
            assert_eq!(read(&path).unwrap(), (at.clone(), channels));
        }
        fs::write(&path, "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n").unwrap();
        assert!(read(&path).is_err());
    }
}
