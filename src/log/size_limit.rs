//! A file that reaches the limit on its size (RLIMIT_FSIZE, `ulimit -f`) is an error of the log, counted
//! like a full disk. By default the system ends the process at that write, and the axes with it.
//!
//! Invariant: after [`is_an_error`] no write of this process is answered by SIGXFSZ.

use nix::errno::Errno;
use nix::sys::signal::{SigSet, Signal};

/// Blocks the signal in this thread and in those that it starts: a write beyond the limit fails instead.
/// Call it before there is a second thread.
///
/// # Errors
/// None is known; the system may have its own.
pub fn is_an_error() -> Result<(), Errno> {
    let mut signals = SigSet::empty();
    signals.add(Signal::SIGXFSZ);
    signals.thread_block()
}
