//! The points of COLMAP models, as `.bin` and as `.txt`, whole, cut, and wrong.

mod common;

use common::says;
use gs_model::colmap::{Point, read_points};
use gs_model::dataset::open_points;

const POINTS: [Point; 2] = [
    Point { position: [0.5, -2.0, 1e-3], colour: [255, 0, 17] },
    Point { position: [3.0, 4.0, -5.0], colour: [1, 2, 3] },
];

fn binary(points: &[Point]) -> Vec<u8> {
    let mut out = (points.len() as u64).to_le_bytes().to_vec();
    for (id, p) in (1u64..).zip(points) {
        out.extend(id.to_le_bytes());
        out.extend(p.position.iter().flat_map(|v| v.to_le_bytes()));
        out.extend(p.colour);
        out.extend(0.25f64.to_le_bytes());
        // It shows in as many images as its number says.
        out.extend(id.to_le_bytes());
        out.extend((0..id).flat_map(|_| [7; 8]));
    }
    out
}

fn text(points: &[Point]) -> Vec<u8> {
    let mut out = "# 3D point list\n".to_owned();
    for (id, Point { position: [x, y, z], colour: [r, g, b] }) in (1..).zip(points) {
        out += &format!("{id} {x} {y} {z} {r} {g} {b} 0.25 1 7 2 9\n");
    }
    out.into_bytes()
}

fn read(name: &str, bytes: &[u8]) -> gs_model::Result<Vec<Point>> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join(name), bytes).unwrap();
    read_points(dir.path())
}

#[test]
fn binary_and_text_hold_the_same_points() {
    assert_eq!(read("points3D.bin", &binary(&POINTS)).unwrap(), POINTS);
    assert_eq!(read("points3D.txt", &text(&POINTS)).unwrap(), POINTS);
}

#[test]
fn a_binary_file_cut_at_any_byte_is_an_error() {
    let whole = binary(&POINTS);
    for len in 0..whole.len() {
        says(read("points3D.bin", &whole[..len]), &format!("truncated at byte {len}"));
    }
    let mut promising = whole;
    promising[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    says(read("points3D.bin", &promising), "promises");
}

#[test]
fn what_cannot_be_trained_from_is_named() {
    says(read("points3D.bin", &binary(&[])), "points3D.bin: the list of points: it is empty");
    says(read("points3D.txt", b"1 0 0 0 256 0 0 0.1\n"), "line 1: bad colour");
    let nowhere = Point { position: [0.0, f64::NAN, 0.0], ..POINTS[0] };
    says(read("points3D.bin", &binary(&[POINTS[1], nowhere])), "point 1: its position");
    says(open_points(tempfile::tempdir().unwrap().path()), "points3D");
}
