//! Tells the program the commit it is built from, so that every log and report can name it.

use std::path::Path;
use std::process::Command;

fn main() {
    // Naming a file that is not there would build everything anew each time.
    for watched in [".git/HEAD", ".git/index", "build.rs"].into_iter().filter(|path| Path::new(path).exists())
    {
        println!("cargo::rerun-if-changed={watched}");
    }
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        output.status.success().then(|| text.trim().to_owned())
    };
    // A source archive has no commit; the version still says what it is.
    let commit = git(&["rev-parse", "--short=12", "HEAD"]).unwrap_or_else(|| "unknown".to_owned());
    let is_changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|s| !s.is_empty());
    println!("cargo::rustc-env=QUADRANT_COMMIT={commit}{}", if is_changed { "+" } else { "" });
}
