//! What a PLY file holds beyond the floats of its Gaussians: normals, columns of other tools, other
//! elements, numbers that a float cannot hold. A lossless stream keeps the floats alone.

use std::io::{BufRead, BufReader, Read};

/// What would be lost, in words; empty if nothing.
pub(crate) type Lost = Vec<String>;

/// Most bytes of a header; gs-model's reader has a limit too, and reports what is wrong.
const MAX_HEADER: u64 = 1 << 20;

/// Names of the columns that make a Gaussian.
fn is_kept(name: &str) -> bool {
    let fixed = ["x", "y", "z", "opacity"].contains(&name);
    fixed || ["f_dc_", "f_rest_", "scale_", "rot_"].iter().any(|p| name.starts_with(p))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

/// A column of an element.
#[derive(Debug)]
struct Column {
    name: String,
    /// None: a list.
    kind: Option<Kind>,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: u64,
    columns: Vec<Column>,
}

impl Kind {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Signed(1),
            "short" | "int16" => Self::Signed(2),
            "int" | "int32" => Self::Signed(4),
            "uchar" | "uint8" => Self::Unsigned(1),
            "ushort" | "uint16" => Self::Unsigned(2),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::Signed(n) | Self::Unsigned(n) => n,
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// The number in `bytes`.
    fn value(self, bytes: &[u8], encoding: Encoding) -> f64 {
        let mut wide = [0u8; 8];
        let n = self.bytes();
        wide[..n].copy_from_slice(&bytes[..n]);
        if encoding == Encoding::Big {
            wide[..n].reverse();
        }
        let bits = u64::from_le_bytes(wide);
        match self {
            Self::Unsigned(_) => bits as f64,
            Self::Signed(n) => {
                let unused = 64 - 8 * n as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
            Self::Float => f64::from(f32::from_bits(bits as u32)),
            Self::Double => f64::from_bits(bits),
        }
    }
}

/// What is lost of each column.
#[derive(Clone, Copy, Default)]
struct Found {
    not_zero: bool,
    no_float: bool,
}

impl Found {
    fn add(&mut self, value: f64) {
        self.not_zero |= value != 0.0;
        self.no_float |= !value.is_nan() && f64::from(value as f32) != value;
    }
}

/// Looks through a PLY file; whatever is no PLY holds nothing more. A file that is damaged holds
/// what was found before the damage: its reader says what is wrong.
pub(crate) fn find(file: impl Read) -> Lost {
    let mut file = BufReader::with_capacity(1 << 16, file);
    let Some((encoding, elements)) = header(&mut file) else { return Lost::new() };
    let mut lost = Lost::new();
    for element in &elements {
        let is_vertex = element.name == "vertex";
        if !is_vertex && element.count > 0 {
            lost.push(format!("element {} ({} rows)", element.name, element.count));
        }
    }
    let Some(at) = elements.iter().position(|e| e.name == "vertex") else { return lost };
    let before = elements[..at].iter().try_for_each(|e| skip(&mut file, encoding, e));
    let vertex = &elements[at];
    if before.is_none() || vertex.columns.iter().any(|c| c.kind.is_none()) {
        // Lists have no fixed place: what these columns hold is not known.
        let unknown = vertex.columns.iter().filter(|c| !is_kept(&c.name));
        lost.extend(unknown.map(|c| format!("{} (not looked at)", c.name)));
        return lost;
    }
    let mut found = vec![Found::default(); vertex.columns.len()];
    // Where the rows end early, what was found until then counts.
    let _ = match encoding {
        Encoding::Ascii => words(&mut file, vertex, &mut found),
        _ => rows(&mut file, encoding, vertex, &mut found),
    };
    for (column, found) in vertex.columns.iter().zip(found) {
        match is_kept(&column.name) {
            false if found.not_zero => lost.push(column.name.clone()),
            true if found.no_float => lost.push(format!("{} beyond float precision", column.name)),
            _ => {}
        }
    }
    lost
}

fn header(file: &mut impl BufRead) -> Option<(Encoding, Vec<Element>)> {
    let mut file = file.take(MAX_HEADER);
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut first = true;
    loop {
        let mut line = Vec::new();
        if file.read_until(b'\n', &mut line).ok()? == 0 {
            return None;
        }
        let line = String::from_utf8_lossy(&line);
        let words: Vec<&str> = line.split_whitespace().collect();
        if std::mem::take(&mut first) {
            if words != ["ply"] {
                return None;
            }
            continue;
        }
        match words[..] {
            ["format", "ascii", ..] => encoding = Some(Encoding::Ascii),
            ["format", "binary_little_endian", ..] => encoding = Some(Encoding::Little),
            ["format", "binary_big_endian", ..] => encoding = Some(Encoding::Big),
            ["element", name, count] => {
                let count = count.parse().ok()?;
                elements.push(Element { name: name.into(), count, columns: Vec::new() });
            }
            ["property", "list", _, _, name] => {
                elements.last_mut()?.columns.push(Column { name: name.into(), kind: None });
            }
            ["property", kind, name] => {
                let kind = Some(Kind::of(kind)?);
                elements.last_mut()?.columns.push(Column { name: name.into(), kind });
            }
            ["end_header"] => return Some((encoding?, elements)),
            _ => {}
        }
    }
}

/// Bytes of a row, if it has no list.
fn stride(element: &Element) -> Option<usize> {
    element.columns.iter().map(|c| c.kind.map(Kind::bytes)).sum()
}

/// Passes over an element; `None` if its length is not known.
fn skip(file: &mut impl BufRead, encoding: Encoding, element: &Element) -> Option<()> {
    if encoding == Encoding::Ascii {
        for _ in 0..element.count {
            next_line(file)?;
        }
        return Some(());
    }
    let len = element.count.checked_mul(stride(element)? as u64)?;
    let skipped = std::io::copy(&mut file.take(len), &mut std::io::sink()).ok()?;
    (skipped == len).then_some(())
}

/// The next line that is not empty.
fn next_line(file: &mut impl BufRead) -> Option<String> {
    loop {
        let mut line = String::new();
        if file.read_line(&mut line).ok()? == 0 {
            return None;
        }
        if !line.trim().is_empty() {
            return Some(line);
        }
    }
}

fn words(file: &mut impl BufRead, vertex: &Element, found: &mut [Found]) -> Option<()> {
    for _ in 0..vertex.count {
        let line = next_line(file)?;
        for (found, word) in found.iter_mut().zip(line.split_whitespace()) {
            // A float's shortest decimal is no double of the same value: only other columns count.
            found.not_zero |= word.parse::<f64>().ok()? != 0.0;
        }
    }
    Some(())
}

fn rows(
    file: &mut impl BufRead,
    encoding: Encoding,
    vertex: &Element,
    found: &mut [Found],
) -> Option<()> {
    let mut row = vec![0u8; stride(vertex)?];
    // Floats that are kept need not be looked at.
    let mut at = 0;
    let mut places = Vec::new();
    for (i, column) in vertex.columns.iter().enumerate() {
        let kind = column.kind?;
        if !(is_kept(&column.name) && matches!(kind, Kind::Float)) {
            places.push((i, at, kind));
        }
        at += kind.bytes();
    }
    if places.is_empty() {
        return Some(());
    }
    for _ in 0..vertex.count {
        file.read_exact(&mut row).ok()?;
        for &(i, at, kind) in &places {
            found[i].add(kind.value(&row[at..], encoding));
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ply(format: &str, columns: &str, body: &[u8]) -> Vec<u8> {
        let mut file = format!("ply\nformat {format} 1.0\nelement vertex 2\n");
        for column in columns.split(", ") {
            file += &format!("property {column}\n");
        }
        file += "end_header\n";
        [file.as_bytes(), body].concat()
    }

    #[test]
    fn columns_were_lost_without_a_word() {
        let row =
            |x: f64, nx: f32, id: u8| [&x.to_le_bytes()[..], &nx.to_le_bytes(), &[id]].concat();
        let columns = "double x, float nx, uchar id";
        let of =
            |rows: [Vec<u8>; 2]| find(&ply("binary_little_endian", columns, &rows.concat())[..]);
        assert!(of([row(0.5, 0.0, 0), row(1.0, -0.0, 0)]).is_empty());
        assert_eq!(of([row(0.5, 0.0, 0), row(0.5, 1.0, 0)]), ["nx"]);
        assert_eq!(of([row(0.1, 0.0, 7), row(0.5, 0.0, 0)]), ["x beyond float precision", "id"]);
        let swapped = [1.5f32, 0.0, 2.0, 0.0].map(f32::to_be_bytes).concat();
        assert!(find(&ply("binary_big_endian", "float x, float nx", &swapped)[..]).is_empty());
        assert_eq!(find(&ply("ascii", "float x, short tag", b"0.1 0\n0.2 3\n")[..]), ["tag"]);
        assert!(find(&b"NGSP"[..]).is_empty());
    }
}
