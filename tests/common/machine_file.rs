//! A machine as a file, for programs that are given one.

use std::fs;
use std::path::{Path, PathBuf};

use quadrant::config::EMBEDDED;

/// The reference machine with so much travel, mm, less 2 mm at either end, and changes to it.
pub(crate) fn machine_file(
    folder: &Path,
    name: &str,
    travel_mm: [f64; 2],
    edits: &[(&str, &str)],
) -> PathBuf {
    let [min, max] = travel_mm;
    let travel = [
        ("travel-min-mm = -250.0", &*format!("travel-min-mm = {min:?}")),
        ("travel-max-mm = 250.0", &*format!("travel-max-mm = {max:?}")),
        ("travel-margin-mm = 5.0", "travel-margin-mm = 2.0"),
    ];
    let changed = travel.iter().chain(edits).fold(EMBEDDED[0].1.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "no `{from}`");
        text.replace(from, to)
    });
    let path = folder.join(name);
    fs::write(&path, changed).unwrap();
    path
}
