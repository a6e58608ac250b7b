//! Helpers shared by the integration tests.
#![allow(dead_code, reason = "each test binary uses some of them")]

use std::path::PathBuf;

use gs_model::{Error, ReadOptions, Report, Result, SH_C0, Scene, model};

/// A path in the shared test data beside the workspace, or `None` with a message if it is absent.
pub(crate) fn shared(path: &str) -> Option<PathBuf> {
    let full = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(path);
    if full.exists() {
        Some(full)
    } else {
        eprintln!("SKIPPED: no {}", full.display());
        None
    }
}

/// A file of `fixtures`.
pub(crate) fn fixture(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../fixtures").join(name)
}

/// Reads a model of that name from bytes.
pub(crate) fn read(name: &str, bytes: &[u8]) -> Result<(Scene, Report)> {
    model::read_named(name, bytes, &ReadOptions::default())
}

/// The message of an error that is one line of plain words, begins with the file's name and says `needle`.
#[track_caller]
pub(crate) fn says<T: std::fmt::Debug>(outcome: Result<T>, needle: &str) -> String {
    let text = gs_model::chain(&outcome.unwrap_err());
    assert!(text.contains(needle), "{needle:?} is not in {text:?}");
    assert!(text.lines().count() == 1 && !text.contains("{ ") && text.contains(": "), "{text}");
    text
}

/// A part of a file that is missing, or is not as it must be.
pub(crate) fn is_broken(error: &Error) -> bool {
    let known = matches!(
        error,
        Error::Truncated { .. }
            | Error::Malformed { .. }
            | Error::OtherFormat { .. }
            | Error::NoModel { .. }
            | Error::InvalidGaussian { .. }
    );
    known && gs_model::chain(error).lines().count() == 1
}

/// A small scene: every number differs from every other, signs and magnitudes vary.
pub(crate) fn scene(n: usize, sh_degree: u8) -> Scene {
    let mut count = 0u32;
    let mut next = || {
        count += 1;
        let magnitude = [1e-3, 0.5, 1.0, 40.0][count as usize % 4];
        let sign = if count.is_multiple_of(3) { -1.0 } else { 1.0 };
        sign * magnitude * (1.0 + count as f32 / 1024.0)
    };
    let k = usize::from(sh_degree + 1) * usize::from(sh_degree + 1);
    Scene {
        means: (0..n).map(|_| [next(), next(), next()]).collect(),
        rotations: (0..n).map(|_| [next(), next(), next(), next()]).collect(),
        log_scales: (0..n).map(|_| [next(), next(), next()]).collect(),
        opacity_logits: (0..n).map(|_| next()).collect(),
        sh_degree,
        sh: (0..n * k).map(|_| [next(), next(), next()]).collect(),
        ..Scene::default()
    }
}

/// All numbers of a scene as bits, so that -0 and 0 differ.
pub(crate) fn bits(scene: &Scene) -> Vec<u32> {
    let arrays: [&[f32]; 5] = [
        scene.means.as_flattened(),
        scene.rotations.as_flattened(),
        scene.log_scales.as_flattened(),
        &scene.opacity_logits,
        scene.sh.as_flattened(),
    ];
    arrays.into_iter().flatten().map(|v| v.to_bits()).collect()
}

/// The value of an Inria property of Gaussian `i`, straight from the layout's definition; none
/// for a name that is not in the layout.
pub(crate) fn property(scene: &Scene, i: usize, name: &str) -> Option<f32> {
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
        Self { encoding, line_end: "\n", properties, faces_before, faces_after, normal: 0.0 }
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
                    row.push((f64::from(value.unwrap_or(7.0)), p.kind));
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

/// Share of points that a camera sees in front of it and inside its image.
pub(crate) fn share_in_view(camera: &gs_model::Camera, points: &[[f64; 3]]) -> f64 {
    let seen = points.iter().filter(|&&p| {
        let c = camera.rotation * glam::DVec3::from_array(p) + camera.translation;
        let u = camera.fx * c.x / c.z + camera.cx;
        let v = camera.fy * c.y / c.z + camera.cy;
        c.z > 0.0
            && (0.0..f64::from(camera.width)).contains(&u)
            && (0.0..f64::from(camera.height)).contains(&v)
    });
    seen.count() as f64 / points.len() as f64
}

/// The largest differences of two scenes: means, rotations (1 - |cosine|, half turns about an axis of the
/// Gaussian left out), log-scales, opacities, colours, SH coefficients above degree 0.
fn differences(a: &Scene, b: &Scene) -> [f32; 6] {
    assert_eq!((a.len(), a.sh_degree), (b.len(), b.sh_degree));
    let mut worst = [0.0f32; 6];
    let mut see = |k: usize, v: f32| {
        assert!(v.is_finite());
        worst[k] = worst[k].max(v);
    };
    let opacity = |l: f32| 1.0 / (1.0 + libm::exp(-f64::from(l)));
    for i in 0..a.len() {
        for k in 0..3 {
            see(0, (a.means[i][k] - b.means[i][k]).abs());
            see(2, (a.log_scales[i][k] - b.log_scales[i][k]).abs());
            see(4, SH_C0 * (a.sh_of(i)[0][k] - b.sh_of(i)[0][k]).abs());
            for (p, q) in a.sh_of(i)[1..].iter().zip(&b.sh_of(i)[1..]) {
                see(5, (p[k] - q[k]).abs());
            }
        }
        let [p, q] = [a, b].map(|s| {
            let [w, x, y, z] = s.rotations[i].map(f64::from);
            glam::DQuat::from_xyzw(x, y, z, w).normalize()
        });
        // From one to the other: half a turn about an axis changes nothing of a Gaussian.
        let between = glam::DVec4::from(p.conjugate() * q).abs();
        see(1, 1.0 - between.max_element() as f32);
        see(3, (opacity(a.opacity_logits[i]) - opacity(b.opacity_logits[i])).abs() as f32);
    }
    worst
}

#[track_caller]
pub(crate) fn assert_within(what: &str, a: &Scene, b: &Scene, bounds: [f32; 6]) {
    let worst = differences(a, b);
    println!("{what}: {worst:?}");
    for (k, (d, bound)) in worst.into_iter().zip(bounds).enumerate() {
        assert!(d <= bound, "{what}, attribute {k}: {worst:?} of {bounds:?}");
    }
}
