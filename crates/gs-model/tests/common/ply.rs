//! PLY files of any form, written one number at a time.

use gs_model::Scene;

/// The value of an Inria property of Gaussian `i`, straight from the layout's definition; none
/// for a name that is not in the layout.
fn property(scene: &Scene, i: usize, name: &str) -> Option<f32> {
    let (stem, index) = match name.rsplit_once('_') {
        Some((stem, index)) => (stem, index.parse::<usize>().ok()?),
        None => (name, 0),
    };
    let rest = scene.sh_len() - 1;
    match stem {
        "x" => Some(scene.means[i][0]),
        "y" => Some(scene.means[i][1]),
        "z" => Some(scene.means[i][2]),
        "nx" | "ny" | "nz" => Some(0.0),
        "f_dc" => Some(scene.sh_of(i)[0][index]),
        "f_rest" => Some(scene.sh_of(i)[1 + index % rest][index / rest]),
        "opacity" => Some(scene.opacity_logits[i]),
        "scale" => Some(scene.log_scales[i][index]),
        "rot" => Some(scene.rotations[i][index]),
        _ => None,
    }
}

/// An ASCII file with these columns and rows: bytes for colours, floats for all else.
pub(crate) fn ascii_ply(columns: &str, rows: &[&[f32]]) -> Vec<u8> {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    for column in columns.split_whitespace() {
        let kind = if ["red", "green", "blue"].contains(&column) { "uchar" } else { "float" };
        text += &format!("property {kind} {column}\n");
    }
    text += "end_header\n";
    for row in rows {
        text += &row.iter().map(|v| format!("{v} ")).collect::<String>();
        text += "\n";
    }
    text.into_bytes()
}

/// A property of a generated file.
#[derive(Clone)]
pub(crate) struct Property {
    pub(crate) name: String,
    /// PLY type; a list of it if `list`.
    pub(crate) kind: &'static str,
    pub(crate) list: bool,
}

/// A description of a PLY file, written one number at a time.
#[derive(Clone)]
pub(crate) struct File {
    /// As the header names it.
    pub(crate) encoding: &'static str,
    pub(crate) line_end: &'static str,
    pub(crate) properties: Vec<Property>,
    /// Rows with lists, in elements before and after `vertex`.
    pub(crate) faces_before: usize,
    pub(crate) faces_after: usize,
    /// The normals' components of every second Gaussian.
    pub(crate) normal: f32,
    /// What is added to the positions.
    pub(crate) shift: [f64; 3],
}

impl File {
    /// The Inria layout.
    pub(crate) fn inria(encoding: &'static str, sh_degree: u8) -> Self {
        let rest = [0, 9, 24, 45][usize::from(sh_degree)];
        let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).into();
        names.extend((0..3).map(|i| format!("f_dc_{i}")));
        names.extend((0..rest).map(|i| format!("f_rest_{i}")));
        names.push("opacity".into());
        names.extend((0..3).map(|i| format!("scale_{i}")));
        names.extend((0..4).map(|i| format!("rot_{i}")));
        let float = |name| Property { name, kind: "float", list: false };
        let properties = names.into_iter().map(float).collect();
        let (faces_before, faces_after) = (0, 0);
        let (normal, shift) = (0.0, [0.0; 3]);
        Self { encoding, line_end: "\n", properties, faces_before, faces_after, normal, shift }
    }

    /// The bytes of the file; the second value is the length of the header.
    pub(crate) fn bytes(&self, scene: &Scene) -> (Vec<u8>, usize) {
        let mut header = vec!["ply".to_owned(), format!("format {} 1.0", self.encoding)];
        header.push("comment made by a test".into());
        let faces = |name: &str, n: usize| {
            let list = "property list uchar int vertex_indices".to_owned();
            [format!("element {name} {n}"), list, "property short flags".to_owned()]
        };
        if self.faces_before > 0 {
            header.extend(faces("before", self.faces_before));
        }
        header.push(format!("element vertex {}", scene.len()));
        for p in &self.properties {
            let list = if p.list { "list uchar " } else { "" };
            header.push(format!("property {list}{} {}", p.kind, p.name));
        }
        if self.faces_after > 0 {
            header.extend(faces("after", self.faces_after));
        }
        header.push("end_header".into());
        let mut out =
            header.iter().flat_map(|l| [l, self.line_end]).collect::<String>().into_bytes();
        let header_len = out.len();

        self.faces(&mut out, self.faces_before);
        for i in 0..scene.len() {
            let mut row = Vec::new();
            for p in &self.properties {
                let value = match p.name.as_str() {
                    "nx" | "ny" | "nz" if i % 2 == 1 => Some(self.normal),
                    name => property(scene, i, name),
                };
                if p.list {
                    // Lengths 0, 1, 2, 0, ...
                    row.push((i as f64 % 3.0, "uchar"));
                    row.extend((0..i % 3).map(|j| (j as f64, p.kind)));
                } else {
                    let axis = ["x", "y", "z"].iter().position(|axis| *axis == p.name);
                    let shift = axis.map_or(0.0, |k| self.shift[k]);
                    row.push((shift + f64::from(value.unwrap_or(7.0)), p.kind));
                }
            }
            self.row(&mut out, &row);
        }
        self.faces(&mut out, self.faces_after);
        (out, header_len)
    }

    fn faces(&self, out: &mut Vec<u8>, n: usize) {
        for i in 0..n {
            let mut row = vec![((i % 4) as f64, "uchar")];
            row.extend((0..i % 4).map(|v| (v as f64, "int")));
            row.push((-1.0, "short"));
            self.row(out, &row);
        }
    }

    fn row(&self, out: &mut Vec<u8>, row: &[(f64, &str)]) {
        for &(value, kind) in row {
            let little: Vec<u8> = match kind {
                "char" | "int8" => (value as i8).to_le_bytes().into(),
                "uchar" | "uint8" => (value as u8).to_le_bytes().into(),
                "short" | "int16" => (value as i16).to_le_bytes().into(),
                "ushort" | "uint16" => (value as u16).to_le_bytes().into(),
                "int" | "int32" => (value as i32).to_le_bytes().into(),
                "uint" | "uint32" => (value as u32).to_le_bytes().into(),
                "float" | "float32" => (value as f32).to_le_bytes().into(),
                "double" | "float64" => value.to_le_bytes().into(),
                other => panic!("{other}"),
            };
            match self.encoding {
                ASCII => out.extend(format!("{value} ").bytes()),
                LITTLE => out.extend(little),
                _ => out.extend(little.iter().rev()),
            }
        }
        if self.encoding == ASCII {
            out.extend(self.line_end.bytes());
        }
    }
}

pub(crate) const ASCII: &str = "ascii";
pub(crate) const LITTLE: &str = "binary_little_endian";
pub(crate) const ENCODINGS: [&str; 3] = [ASCII, LITTLE, "binary_big_endian"];
