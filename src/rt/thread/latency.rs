//! Keeps the processor awake: while `/dev/cpu_dma_latency` is open with a zero in it, no idle state is
//! entered whose exit takes longer than that. Waking from a deep one takes up to some 100 us.
//!
//! Invariant: the request stands as long as the [`Hold`] lives, and not longer.

use std::fs::File;
use std::io::{self, Read, Write};

use nix::errno::Errno;

/// Where the system takes the request.
const DEVICE: &str = "/dev/cpu_dma_latency";

/// A standing request for no exit latency at all.
#[derive(Debug)]
pub struct Hold {
    _request: File,
    effective_us: i32,
}

impl Hold {
    /// What all requests of the machine together allow, read back, us.
    pub const fn effective_us(&self) -> i32 {
        self.effective_us
    }
}

/// Asks for it.
pub(super) fn hold() -> Result<Hold, Errno> {
    request().map_err(|error| Errno::from_raw(error.raw_os_error().unwrap_or(0)))
}

fn request() -> io::Result<Hold> {
    let mut request = File::options().read(true).write(true).open(DEVICE)?;
    request.write_all(&0_i32.to_ne_bytes())?;
    let mut answer = [0; 4];
    request.read_exact(&mut answer)?;
    Ok(Hold { _request: request, effective_us: i32::from_ne_bytes(answer) })
}
