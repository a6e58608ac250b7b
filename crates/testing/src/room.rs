//! The scene of `fixtures/room`, to be damaged.

use std::fs;
use std::path::Path;

use crate::real::fixture;

/// Copies cameras, photos and model of the room into a folder, which is made.
///
/// # Panics
/// If a file cannot be copied.
pub fn copy_room(into: &Path) {
    let room = fixture("room");
    for folder in ["", "images", "sparse/0"] {
        fs::create_dir_all(into.join(folder)).unwrap();
        for entry in fs::read_dir(room.join(folder)).unwrap().map(Result::unwrap) {
            if entry.path().is_file() {
                fs::copy(entry.path(), into.join(folder).join(entry.file_name())).unwrap();
            }
        }
    }
}
