//! Broken and hostile PLY files: a typed error, never a panic, never memory beyond the input.

mod common;

use common::{FORMATS, File, Property, scene};
use gs_model::ply::{self, Format};
use gs_model::{Error, Result, Scene};

fn read(bytes: &[u8]) -> Result<Scene> {
    ply::read_bytes(bytes).map(|(scene, _)| scene)
}

fn read_text(text: &str) -> Result<Scene> {
    read(text.as_bytes())
}

/// A small file with every feature of the format.
fn tricky(format: Format) -> (Vec<u8>, usize, Scene) {
    let scene = scene(3, 0);
    let mut file = File::inria(format, 0);
    file.faces_before = 2;
    file.faces_after = 2;
    file.properties.insert(4, Property { name: "list".into(), kind: "short", list: true });
    let (bytes, header) = file.bytes(&scene);
    (bytes, header, scene)
}

#[test]
fn cut_at_every_byte_is_a_typed_error() {
    for format in FORMATS {
        for plain in [true, false] {
            let (bytes, header, whole) = if plain {
                let scene = scene(3, 1);
                let (bytes, header) = File::inria(format, 1).bytes(&scene);
                (bytes, header, scene)
            } else {
                tricky(format)
            };
            for len in 0..bytes.len() {
                let cut = &bytes[..len];
                match read(cut) {
                    Err(Error::PlyMagic { .. }) => assert!(len < 4, "{format} {len}"),
                    Err(Error::PlyHeaderTruncated { len: at, .. }) => {
                        assert!(len < header && at == len, "{format} {len}");
                    }
                    Err(Error::PlyTruncated { len: at, promised, row, .. }) => {
                        assert!(len >= header && at == len && row < promised, "{format} {len}");
                    }
                    Err(Error::PlyRow { .. } | Error::PlyNumber { .. }) => {
                        assert!(format == Format::Ascii && len >= header, "{format} {len}");
                    }
                    // Text cut in its last number or after it is still whole text.
                    Ok(scene) => {
                        assert!(format == Format::Ascii, "{format} {len}");
                        let trimmed = bytes.trim_ascii_end();
                        let last_number = trimmed.iter().rposition(|&b| b == b' ').unwrap() + 1;
                        assert!(len > last_number, "{len}");
                        assert_eq!(scene.len(), whole.len());
                    }
                    Err(other) => panic!("{format} {len}: {other}"),
                }
            }
            read(&bytes).unwrap();
        }
    }
}

#[test]
fn no_single_bit_flip_panics() {
    let mut refused = 0;
    for format in FORMATS {
        let (bytes, header, _) = tricky(format);
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut flipped = bytes.clone();
                flipped[at] ^= 1 << bit;
                if let Err(error) = read(&flipped) {
                    refused += usize::from(at < header);
                    assert_eq!(error.to_string().lines().count(), 1, "{error}");
                }
            }
        }
    }
    // Most flips in a header break it; those in comments and in names of unknown properties do
    // not.
    assert!(refused > 5000, "{refused}");
}

#[test]
fn promises_beyond_the_file_fail_before_any_allocation() {
    // Each of these would ask for at least a terabyte, or overflow, if it were believed.
    for format in FORMATS {
        let (bytes, header, _) = tricky(format);
        let text = String::from_utf8_lossy(&bytes[..header]).into_owned();
        for element in ["before 2", "vertex 3", "after 2"] {
            for count in [4_000_000_000, u64::MAX / 200, u64::MAX / 3, u64::MAX] {
                let name = element.split(' ').next().unwrap();
                let claim =
                    text.replace(&format!("element {element}"), &format!("element {name} {count}"));
                assert_ne!(claim, text);
                let mut file = claim.into_bytes();
                file.extend(&bytes[header..]);
                match read(&file) {
                    Err(Error::PlyTruncated { element, promised, len, .. }) => {
                        assert_eq!((element.as_str(), promised, len), (name, count, file.len()));
                    }
                    other => panic!("{format} {element} {count}: {other:?}"),
                }
            }
        }
    }
}

#[test]
fn a_huge_element_without_properties_takes_no_time() {
    for format in FORMATS {
        let (bytes, _) = File::inria(format, 0).bytes(&scene(1, 0));
        let text = format!("format {format} 1.0\n");
        let at = bytes.windows(text.len()).position(|w| w == text.as_bytes()).unwrap() + text.len();
        let mut file = bytes[..at].to_vec();
        file.extend(format!("element nothing {}\n", u64::MAX).bytes());
        file.extend(&bytes[at..]);
        assert_eq!(read(&file).unwrap().len(), 1, "{format}");
    }
}

#[test]
fn list_lengths_are_checked() {
    let head = "ply\nformat binary_little_endian 1.0\nelement other 1\n";
    let tail = "element vertex 0\nproperty float x\nproperty float y\nproperty float z\n\
        property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n\
        property float opacity\nproperty float scale_0\nproperty float scale_1\n\
        property float scale_2\nproperty float rot_0\nproperty float rot_1\n\
        property float rot_2\nproperty float rot_3\nend_header\n";
    let file = |kind: &str, body: &[u8]| {
        let mut file = format!("{head}property list {kind} double a\n{tail}").into_bytes();
        file.extend(body);
        read(&file)
    };
    assert!(file("char", &[0]).is_ok());
    assert!(matches!(file("char", &[0xff]), Err(Error::PlyListLength { .. })));
    for kind in ["float", "double"] {
        assert!(matches!(file(kind, &[0; 8]), Err(Error::PlyHeader { line: 4, .. })), "{kind}");
    }
    assert!(matches!(file("int", &i32::MIN.to_le_bytes()), Err(Error::PlyListLength { .. })));
    assert!(matches!(file("uint", &[0xff; 4]), Err(Error::PlyTruncated { .. })));
}

/// A header with these lines between `ply` and `end_header`.
fn header(lines: &str) -> Result<Scene> {
    read_text(&format!("ply\n{lines}end_header\n"))
}

#[test]
fn header_mistakes_are_named() {
    fn reason(outcome: Result<Scene>) -> (usize, &'static str) {
        match outcome {
            Err(Error::PlyHeader { line, reason, .. }) => (line, reason),
            other => panic!("{other:?}"),
        }
    }
    let ascii = "format ascii 1.0\n";
    assert_eq!(reason(header("")), (2, "no format line before it"));
    assert_eq!(reason(header("format ascii 2.0\n")), (2, "format version is not 1.0"));
    assert_eq!(reason(header("format text 1.0\n")), (2, "unknown format"));
    assert_eq!(reason(header(&format!("{ascii}{ascii}"))), (3, "second format line"));
    assert_eq!(reason(header("format ascii 1.0\nvertex 3\n")), (3, "unknown keyword"));
    for count in ["-1", "1.5", "x", "99999999999999999999"] {
        let lines = format!("{ascii}element vertex {count}\n");
        assert_eq!(reason(header(&lines)), (3, "bad element count"));
    }
    assert_eq!(reason(header("element vertex\n")), (2, "expected: element NAME COUNT"));
    assert_eq!(reason(header("property float x\n")), (2, "property before the first element"));
    let lines = "element vertex 1\nproperty half x\n";
    assert_eq!(reason(header(lines)), (3, "unknown property type"));
    let lines = "element vertex 1\nproperty list uchar x\n";
    assert_eq!(reason(header(lines)).0, 3);

    let twice = format!("{ascii}element vertex 1\nproperty float x\nproperty uchar x\n");
    match header(&twice) {
        Err(Error::PlyDuplicate { line: 5, what: "property", name, .. }) => assert_eq!(name, "x"),
        other => panic!("{other:?}"),
    }
    let twice = format!("{ascii}element vertex 1\nelement face 0\nelement vertex 1\n");
    match header(&twice) {
        Err(Error::PlyDuplicate { line: 5, what: "element", .. }) => {}
        other => panic!("{other:?}"),
    }
    assert!(matches!(header(ascii), Err(Error::PlyNoVertex { .. })));
}

#[test]
fn other_files_are_refused() {
    for text in ["", "pl", "ply", "plyx\n", "PLY\n", "\u{feff}ply\n", "{}"] {
        assert!(matches!(read_text(text), Err(Error::PlyMagic { .. })), "{text:?}");
    }
    assert!(matches!(read_text("ply\n"), Err(Error::PlyHeaderTruncated { len: 4, .. })));
    let endless = format!("ply\n{}", "comment x\n".repeat(ply::MAX_HEADER_BYTES / 5));
    assert!(matches!(read_text(&endless), Err(Error::PlyHeaderTooLong { .. })));
    let one_line = format!("ply\n{}", "x".repeat(ply::MAX_HEADER_BYTES));
    assert!(matches!(read_text(&one_line), Err(Error::PlyHeaderTooLong { .. })));
    match ply::read("/nowhere/at/all.ply") {
        Err(Error::Io { action: "read", .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn rest_counts_without_a_degree_are_refused() {
    for (keep, degree) in [(1, 1), (8, 1), (10, 2), (23, 2), (25, 3), (44, 3)] {
        let mut file = File::inria(Format::Ascii, degree);
        file.properties.retain(|p| match p.name.strip_prefix("f_rest_") {
            Some(i) => i.parse::<usize>().unwrap() < keep,
            None => true,
        });
        match read(&file.bytes(&scene(1, degree)).0) {
            Err(Error::PlyRestCount { count, .. }) => assert_eq!(count, keep),
            other => panic!("{keep}: {other:?}"),
        }
    }
    let mut file = File::inria(Format::Ascii, 3);
    let float = |i| Property { name: format!("f_rest_{i}"), kind: "float", list: false };
    file.properties.extend((45..72).map(float));
    let outcome = read(&file.bytes(&scene(0, 3)).0);
    assert!(matches!(outcome, Err(Error::PlyRestCount { count: 72, .. })), "{outcome:?}");
}

#[test]
fn a_list_where_a_number_belongs_is_named() {
    let mut file = File::inria(Format::Ascii, 0);
    file.properties.iter_mut().find(|p| p.name == "opacity").unwrap().list = true;
    match read(&file.bytes(&scene(1, 0)).0) {
        Err(Error::PlyListProperty { property, .. }) => assert_eq!(property, "opacity"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn ascii_rows_are_checked() {
    let (bytes, header) = File::inria(Format::Ascii, 0).bytes(&scene(2, 0));
    let text = String::from_utf8(bytes).unwrap();
    let header_lines = text[..header].lines().count();
    let rows: Vec<&str> = text[header..].lines().collect();
    let file = |first: &str| read_text(&format!("{}{first}\n\n{}\n", &text[..header], rows[1]));
    assert_eq!(file(rows[0]).unwrap().len(), 2);
    match file(&format!("{} 1", rows[0])) {
        Err(Error::PlyRow { line, found: 18, expected: 17, .. }) => {
            assert_eq!(line, header_lines + 1)
        }
        other => panic!("{other:?}"),
    }
    let short = rows[0].trim_end().rsplit_once(' ').unwrap().0;
    assert!(matches!(file(short), Err(Error::PlyRow { found: 16, .. })));
    let words: Vec<&str> = rows[0].split_whitespace().collect();
    for bad in ["one", "0x10", "1,5", "--1"] {
        let mut words = words.clone();
        words[9] = bad;
        match file(&words.join(" ")) {
            Err(Error::PlyNumber { property, text, .. }) => {
                assert_eq!((property.as_str(), text.as_str()), ("opacity", bad))
            }
            other => panic!("{other:?}"),
        }
    }
}
