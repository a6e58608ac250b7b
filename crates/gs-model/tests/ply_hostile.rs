//! Broken and hostile PLY files: a typed error, never a panic, never memory beyond the input.

mod common;

use common::ply::{ASCII, ENCODINGS, File, LITTLE, Property};
use common::{is_broken, says, scene};
use gs_model::ply;
use gs_model::{Error, Result, Scene};

fn read(bytes: &[u8]) -> Result<Scene> {
    ply::read_bytes(bytes).map(|(scene, _)| scene)
}

fn read_text(text: &str) -> Result<Scene> {
    read(text.as_bytes())
}

/// A small file with every feature of the format.
fn tricky(format: &'static str) -> (Vec<u8>, usize, Scene) {
    let scene = scene(3, 0);
    let mut file = File::inria(format, 0);
    file.faces_before = 2;
    file.faces_after = 2;
    let (bytes, header) = file.bytes(&scene);
    (bytes, header, scene)
}

#[test]
fn cut_at_every_byte_is_a_typed_error() {
    for format in ENCODINGS {
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
                    Err(Error::OtherFormat { .. }) => assert!(len < 4, "{format} {len}"),
                    Err(Error::Truncated { len: at, .. }) => {
                        assert!(len >= 4 && at == len, "{format} {len}");
                    }
                    Err(Error::Malformed { place, .. }) => {
                        assert!(format == ASCII && len >= header, "{format} {len}");
                        assert!(place.starts_with("line "), "{place}");
                    }
                    // Text cut in its last number or after it is still whole text.
                    Ok(scene) => {
                        assert!(format == ASCII, "{format} {len}");
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
    for format in ENCODINGS {
        let (bytes, header, _) = tricky(format);
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut flipped = bytes.clone();
                flipped[at] ^= 1 << bit;
                if let Err(error) = read(&flipped) {
                    refused += usize::from(at < header);
                    assert!(is_broken(&error), "{error}");
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
    for format in ENCODINGS {
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
                let promise = format!("promises {count} rows of element {name:?}");
                let text = says(read(&file), &promise);
                assert!(text.contains(&format!("truncated at byte {}", file.len())), "{text}");
            }
        }
    }
}

#[test]
fn a_huge_element_without_properties_takes_no_time() {
    for format in ENCODINGS {
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
    let (empty, header) = File::inria(LITTLE, 0).bytes(&scene(0, 0));
    let empty = String::from_utf8_lossy(&empty[..header]).into_owned();
    let tail = &empty[empty.find("element").unwrap()..];
    let file = |kind: &str, body: &[u8]| {
        let mut file = format!("{head}property list {kind} double a\n{tail}").into_bytes();
        file.extend(body);
        read(&file)
    };
    assert!(file("char", &[0]).is_ok());
    says(file("char", &[0xff]), "a list of negative length");
    says(file("int", &i32::MIN.to_le_bytes()), "a list of negative length");
    says(file("float", &[0; 8]), "header line 4: type of list length is not an integer type");
    says(file("uint", &[0xff; 4]), "row 0 is not whole");
}

/// A header with these lines between `ply` and `end_header`.
fn header(lines: &str) -> Result<Scene> {
    read_text(&format!("ply\n{lines}end_header\n"))
}

#[test]
fn header_mistakes_are_named() {
    let ascii = "format ascii 1.0\n";
    for (lines, said) in [
        ("", "line 2: no format line before it"),
        ("format ascii 2.0\n", "line 2: format version is not 1.0"),
        ("format text 1.0\n", "line 2: unknown format"),
        (&format!("{ascii}{ascii}"), "line 3: second format line"),
        ("format ascii 1.0\nvertex 3\n", "line 3: unknown keyword: \"vertex 3\""),
        ("element vertex\n", "line 2: expected: element NAME COUNT"),
        ("property float x\n", "line 2: property before the first element"),
        ("element vertex 1\nproperty half x\n", "line 3: unknown property type"),
        ("element vertex 1\nproperty list uchar x\n", "line 3: "),
        (
            "element vertex 1\nproperty float x\nproperty uchar x\n",
            "line 4: property is declared twice",
        ),
        (
            "element vertex 1\nelement face 0\nelement vertex 1\n",
            "line 4: element is declared twice; one PLY holds one model",
        ),
        (ascii, "no element \"vertex\""),
    ] {
        says(header(lines), said);
    }
    for count in ["-1", "1.5", "x", "99999999999999999999"] {
        says(header(&format!("{ascii}element vertex {count}\n")), "line 3: bad element count");
    }
}

#[test]
fn other_files_are_refused() {
    for text in ["pl", "ply", "plyx\n", "PLY\n", "\u{feff}ply\n", "{}"] {
        says(read_text(text), "not a PLY file: it starts with");
    }
    says(read_text(""), "<bytes>: is empty");
    says(read_text("ply\n"), "truncated at byte 4");
    let endless = format!("ply\n{}", "comment x\n".repeat(ply::MAX_HEADER_BYTES / 5));
    let one_line = format!("ply\n{}", "x".repeat(ply::MAX_HEADER_BYTES));
    says(read_text(&endless), "no end_header in the first");
    says(read_text(&one_line), "no end_header in the first");
    assert!(matches!(ply::read("/nowhere/at/all.ply"), Err(Error::Io { action: "read", .. })));
}

#[test]
fn rest_counts_without_a_degree_are_refused() {
    for (keep, degree) in [(1, 1), (8, 1), (10, 2), (23, 2), (25, 3), (44, 3)] {
        let mut file = File::inria(ASCII, degree);
        file.properties.retain(|p| match p.name.strip_prefix("f_rest_") {
            Some(i) => i.parse::<usize>().unwrap() < keep,
            None => true,
        });
        says(read(&file.bytes(&scene(1, degree)).0), &format!("{keep} f_rest properties"));
    }
    let mut file = File::inria(ASCII, 3);
    let float = |i| Property { name: format!("f_rest_{i}"), kind: "float", list: false };
    file.properties.extend((45..75).map(float));
    says(read(&file.bytes(&scene(0, 3)).0), "75 f_rest properties");
}

#[test]
fn a_list_where_a_number_belongs_is_named() {
    let mut file = File::inria(ASCII, 0);
    file.properties.iter_mut().find(|p| p.name == "opacity").unwrap().list = true;
    says(read(&file.bytes(&scene(1, 0)).0), "property \"opacity\" is a list; a 3DGS model has");
}

#[test]
fn ascii_rows_are_checked() {
    let (bytes, header) = File::inria(ASCII, 0).bytes(&scene(2, 0));
    let text = String::from_utf8(bytes).unwrap();
    let header_lines = text[..header].lines().count();
    let rows: Vec<&str> = text[header..].lines().collect();
    let file = |first: &str| read_text(&format!("{}{first}\n\n{}\n", &text[..header], rows[1]));
    assert_eq!(file(rows[0]).unwrap().len(), 2);
    let place = format!("line {}: ", header_lines + 1);
    says(file(&format!("{} 1", rows[0])), &(place.clone() + "18 numbers, expected 17"));
    let short = rows[0].trim_end().rsplit_once(' ').unwrap().0;
    says(file(short), &(place.clone() + "16 numbers, expected 17"));
    let words: Vec<&str> = rows[0].split_whitespace().collect();
    for bad in ["one", "0x10", "1,5", "--1"] {
        let mut words = words.clone();
        words[9] = bad;
        let said = format!("{place}property \"opacity\": {bad:?} is not a number");
        says(file(&words.join(" ")), &said);
    }
}
