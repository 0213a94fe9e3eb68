//! A machine for a computer that may be late by milliseconds: the reference machine with a long period, gains
//! that bear it, a hundredth of the friction, so that it still shows protrusions of some 30 um, and supervision
//! that bears more.

use std::fs;
use std::path::{Path, PathBuf};

use quadrant::base::time::Span;

const MACHINE: &str = include_str!("../../firmware-config/machines/reference.toml");
const BOARD: &str = include_str!("../../firmware-config/encoder-board.toml");

/// The circle that it runs: 9 s of machine time, with 4 mm/s so slow that a SYNC that is late by a millisecond
/// finds the axis 4 um further.
pub(crate) const CIRCLE: [&str; 6] = ["--radius-mm", "5", "--feed-mm-per-min", "250", "--direction", "ccw"];

/// The machine with this period, in a folder.
pub(crate) fn machine(folder: &Path, period: Span) -> PathBuf {
    let us = period.as_ns() / 1_000;
    let text = edited(
        MACHINE,
        &[
            ("period-us = 500 ", format!("period-us = {us} ")),
            ("position-loop-every-cycles = 4", "position-loop-every-cycles = 1".to_owned()),
            ("reply-window-us = 300", format!("reply-window-us = {}", us * 7 / 10)),
            ("stale-cycles-max = 2", "stale-cycles-max = 15".to_owned()),
            ("pause-cycles-max = 8 ", "pause-cycles-max = 20 ".to_owned()),
            ("heartbeat-timeout-ms = 350", "heartbeat-timeout-ms = 3000".to_owned()),
            ("overrun-misses-max = 60", "overrun-misses-max = 200".to_owned()),
            ("overrun-drain-cycles = 50", "overrun-drain-cycles = 10".to_owned()),
            ("bus-losses-max = 20", "bus-losses-max = 200".to_owned()),
            ("bus-loss-drain-cycles = 100", "bus-loss-drain-cycles = 10".to_owned()),
            ("sheet = \"encoder-board\"", "sheet = \"slow-board\"".to_owned()),
            ("v-p = 101.121 ", "v-p = 10.112 ".to_owned()),
            ("v-i = 1.140", "v-i = 0.0114".to_owned()),
            ("breakaway-n = 1127.8 ", "breakaway-n = 11.278 ".to_owned()),
            ("sliding-n = 951.3 ", "sliding-n = 9.513 ".to_owned()),
            ("following-error-mm = 1.0 ", "following-error-mm = 5.0 ".to_owned()),
        ],
    );
    let board = edited(BOARD, &[("value = 20_000 }", "value = 300_000 }".to_owned())]);
    let path = folder.join(format!("slow-{us}-us.toml"));
    fs::write(&path, text).unwrap();
    fs::write(folder.join("slow-board.toml"), board).unwrap();
    path
}

fn edited(text: &str, edits: &[(&str, String)]) -> String {
    edits.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "there is no {from:?}");
        text.replace(from, to)
    })
}
