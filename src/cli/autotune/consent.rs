//! Whether the person at the terminal wants what a step does.

use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::{bail, ensure};

/// How soon a wish to stop is heard while an answer is waited for.
const LISTEN: Duration = Duration::from_millis(50);

/// Whether there is somebody to ask, or nobody has to be.
///
/// # Errors
/// When there is neither.
pub(super) fn is_possible(yes: bool) -> anyhow::Result<()> {
    ensure!(
        yes || std::io::stdin().is_terminal(),
        "refused to move a machine unasked: there is no terminal to ask at; --yes says yes to all steps beforehand"
    );
    Ok(())
}

/// Asks, unless `yes` was said beforehand.
///
/// # Errors
/// When the answer is not yes, or none comes before the wish to stop.
pub(super) fn ask(question: &str, yes: bool, stop: &AtomicBool) -> anyhow::Result<()> {
    ensure!(!stop.load(Ordering::Relaxed), "interrupted");
    if yes {
        return Ok(());
    }
    eprint!("{question} [y/N] ");
    std::io::stderr().flush()?;
    // Read elsewhere: a signal does not end the wait for a line.
    let (answer, answered) = mpsc::channel();
    thread::spawn(move || {
        let mut line = String::new();
        let read = std::io::stdin().read_line(&mut line).map(|_| line);
        // Nobody waits any more after a wish to stop.
        let _is_heard = answer.send(read).is_ok();
    });
    let line = loop {
        match answered.recv_timeout(LISTEN) {
            Ok(line) => break line?,
            Err(RecvTimeoutError::Timeout) if stop.load(Ordering::Relaxed) => bail!("interrupted"),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => bail!("standard input gave no answer"),
        }
    };
    ensure!(matches!(line.trim(), "y" | "Y" | "yes"), "declined");
    Ok(())
}
