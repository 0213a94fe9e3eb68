//! Board sheets beside the machine file: found there first, and bad ones named with their own place.

use quadrant::config::{self, Machine};

use super::REFERENCE;

const SHEET: &str = include_str!("../../firmware-config/encoder-board.toml");

/// What is said of the reference machine in a folder with this board sheet.
fn with_sheet(sheet: &str) -> Result<Machine, String> {
    let folder = tempfile::tempdir().expect("a folder for the files");
    let path = folder.path().join("machine.toml");
    std::fs::write(folder.path().join("encoder-board.toml"), sheet).expect("the sheet can be written");
    std::fs::write(&path, REFERENCE).expect("the machine file can be written");
    config::load(&path.to_string_lossy())
        .map_err(|error| error.to_string().replace(&folder.path().display().to_string(), "DIR"))
}

#[test]
fn a_sheet_beside_the_machine_file_comes_before_the_embedded_one() {
    let machine = with_sheet(&SHEET.replacen("value = 20_000", "value = 7000", 1)).expect("a sound sheet");
    assert!(machine.axes.as_slice().iter().all(|axis| axis.sheet.watchdog_us == 7000));
}

#[test]
fn a_bad_sheet_is_named_at_the_axis_with_its_own_line_and_bound() {
    for (from, to, says) in [
        (
            "unit = \"ms\"",
            "unit = \"s\"",
            "DIR/encoder-board.toml:12: protocol.heartbeat-period.unit: is another unit (heartbeat-period counts in \"ms\")",
        ),
        (
            "1017:0",
            "1018:0",
            "DIR/encoder-board.toml:12: protocol.heartbeat-period.object: is another object (heartbeat-period is object 1017:0)",
        ),
        (
            "value = 100 ",
            "value = -1 ",
            "DIR/encoder-board.toml:12: protocol.heartbeat-period.value: -1 ms is outside the allowed range (allowed is a whole number from 0 to 4294967295 ms)",
        ),
        (
            "value = 20_000",
            "value = 7",
            "DIR/encoder-board.toml: watchdog (object 2001:0) is 7 us, allowed are 100 to 1000000",
        ),
        (
            "[current]",
            "[currents]",
            "DIR/encoder-board.toml:1: current: missing, wanted is a section (`current` belongs in here); DIR/encoder-board.toml:20: currents: unknown key (is `current` meant?)",
        ),
        (
            "[current]",
            "[current",
            "DIR/encoder-board.toml:20: TOML: unclosed table, expected `]` (not understood here)",
        ),
        (
            "value = 10_000",
            "value = 30_000",
            "DIR/encoder-board.toml: peak-current (object 2005:0) is 25000 mA, below rated-current (object 6075:0) of 30000 mA",
        ),
    ] {
        assert!(SHEET.contains(from), "the sheet has no {from:?}");
        let said = with_sheet(&SHEET.replacen(from, to, 1)).expect_err(to);
        let expected = |axis: &str, line: usize| {
            format!(
                "\nDIR/machine.toml:{line}: axis.{axis}.board.sheet: no usable board sheet \"encoder-board\" ({says})"
            )
        };
        let line = |n: usize| {
            1 + REFERENCE
                .lines()
                .enumerate()
                .filter(|(_, line)| line.starts_with("sheet ="))
                .nth(n)
                .expect("two boards")
                .0
        };
        let wanted =
            format!("DIR/machine.toml has 2 problems{}{}", expected("x", line(0)), expected("y", line(1)));
        assert_eq!(said, wanted, "after {to:?}");
    }
}
