//! Memory that is there before it is needed: the heap keeps what it got, a reserve of it is touched, and
//! every page of the process, present and future, is locked into memory.
//!
//! A page that is not there costs the cycle a fault: microseconds if it only has to be zeroed,
//! milliseconds if it is on a disk. Sizes are in bytes.
//! Invariant: memory is locked only where the limit cannot make a later allocation fail.

use std::hint::black_box;

use nix::errno::Errno;
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::sys::resource::{RLIM_INFINITY, Resource, getrlimit, setrlimit};

use super::raw;

/// Heap that is touched at start: two rings of records (5 MiB each), the log's backlog at its fullest
/// (8 MiB), and nearly as much again for all the rest.
const HEAP_RESERVE_BYTES: usize = 32 << 20;
/// Stack of the cycle thread that is touched; a cycle needs less than a tenth of it.
const STACK_RESERVE_BYTES: usize = 256 << 10;
/// Number of CAP_IPC_LOCK among the capabilities, capabilities(7): who has it may lock without limit.
const CAP_IPC_LOCK: u32 = 14;

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Whether the allocator keeps what it got.
    pub is_heap_kept: bool,
    /// Bytes that are locked, as the system counts them.
    pub locked: Result<u64, LockRefusal>,
}

/// Why memory is not locked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LockRefusal {
    /// Only so many bytes may be locked: with all future memory locked, an allocation beyond would fail.
    Limit {
        /// The hard limit, RLIMIT_MEMLOCK.
        bytes: u64,
    },
    /// The system refused.
    System(Errno),
}

/// Prepares the memory of the process.
pub(super) fn prepare() -> Memory {
    let is_heap_kept = raw::keep_heap();
    touch_heap();
    Memory { is_heap_kept, locked: lock() }
}

#[cfg_attr(not(test), expect(clippy::disallowed_macros, reason = "before the cycle starts, and for it"))]
fn touch_heap() {
    // Written, not only reserved; when it is freed the heap keeps it.
    black_box(vec![1_u8; HEAP_RESERVE_BYTES].as_mut_slice());
}

/// Touches the stack below the caller.
#[inline(never)]
pub(super) fn touch_stack() {
    black_box([1_u8; STACK_RESERVE_BYTES].as_mut_slice());
}

fn lock() -> Result<u64, LockRefusal> {
    let bytes = raise_to_hard_limit(Resource::RLIMIT_MEMLOCK).map_err(LockRefusal::System)?;
    if bytes != RLIM_INFINITY && !may_lock_without_limit(&status()) {
        return Err(LockRefusal::Limit { bytes });
    }
    let flags = MlockAllFlags::MCL_CURRENT | MlockAllFlags::MCL_FUTURE;
    mlockall(flags).map_err(LockRefusal::System)?;
    Ok(locked_bytes(&status()))
}

/// Uses all of a limit that may be used without asking anybody; returns it.
pub(super) fn raise_to_hard_limit(resource: Resource) -> Result<u64, Errno> {
    let (_, hard) = getrlimit(resource)?;
    setrlimit(resource, hard, hard)?;
    Ok(hard)
}

/// What the system says of this process; nothing where there is no `/proc`.
fn status() -> String {
    std::fs::read_to_string("/proc/self/status").unwrap_or_default()
}

/// The value of a key in the text of `/proc/self/status`.
fn value<'t>(status: &'t str, key: &str) -> Option<&'t str> {
    status.lines().find_map(|line| line.strip_prefix(key)).map(str::trim)
}

fn may_lock_without_limit(status: &str) -> bool {
    let capabilities = value(status, "CapEff:").and_then(|hex| u64::from_str_radix(hex, 16).ok());
    capabilities.is_some_and(|capabilities| capabilities >> CAP_IPC_LOCK & 1 == 1)
}

fn locked_bytes(status: &str) -> u64 {
    let kilobytes = value(status, "VmLck:").and_then(|text| text.strip_suffix(" kB"));
    kilobytes.and_then(|text| text.parse::<u64>().ok()).unwrap_or(0) << 10
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATUS: &str = "Name:\tquadrantd\nVmLck:\t   48204 kB\nCapPrm:\t0000000000000000\nCapEff:\t";

    #[test]
    fn what_may_be_locked_stands_in_the_capabilities() {
        let may = |effective: &str| may_lock_without_limit(&format!("{STATUS}{effective}\nSeccomp:\t0\n"));
        assert!(may("0000000000004000"), "CAP_IPC_LOCK alone");
        assert!(may("000001ffffffffff"), "all of them");
        assert!(!may("0000000000000000") && !may("0000000000800000"), "none, and CAP_SYS_NICE alone");
        assert!(!may("none") && !may_lock_without_limit(""), "what is not understood allows nothing");
    }

    #[test]
    fn locked_memory_is_read_in_bytes() {
        assert_eq!(locked_bytes(STATUS), 48_204 * 1024);
        assert_eq!(locked_bytes("VmLck:\t 7 pages\n"), 0);
        assert_eq!(locked_bytes(""), 0);
    }
}
